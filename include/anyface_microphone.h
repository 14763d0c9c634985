/*
 * A microphone for hosts that have none: mono, 16 kHz, as anyface_weight_stream_push() takes it.
 *
 * Generated from microphone/src by `cargo xtask header`; change it there. It is a library of its own,
 * libanyface_microphone, since it needs the system's sound.
 */


#ifndef ANYFACE_MICROPHONE_H
#define ANYFACE_MICROPHONE_H

#include <stddef.h>
#include <stdint.h>

/// A device that is being recorded. It belongs to one thread at a time.
typedef struct AnyfaceMicrophone AnyfaceMicrophone;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/// Records the device of that name, of which a part is enough, or the system's choice for NULL. The system may ask its
/// user first. A device that goes away is waited for.
///
/// Returns NULL where nothing can be recorded; `message`, of `message_size` bytes, then says why. Close with
/// `anyface_microphone_close()`.
AnyfaceMicrophone *anyface_microphone_open(const char *name,
                                           char *message,
                                           size_t message_size);

/// Name of the device that is recorded, written into `name` of `name_size` bytes. Returns the bytes that the whole name needs.
size_t anyface_microphone_name(const AnyfaceMicrophone *microphone,
                               char *name,
                               size_t name_size);

/// Takes what has come, at once: at most `sample_count` samples into `samples`, mono, 16 kHz, -1 to 1. Returns how many.
///
/// `is_lost`, which may be NULL, receives 1 where they are silence in place of a device that is gone, else 0.
size_t anyface_microphone_read(AnyfaceMicrophone *microphone,
                               float *samples,
                               size_t sample_count,
                               int32_t *is_lost);

/// Ends recording; nothing happens for NULL.
void anyface_microphone_close(AnyfaceMicrophone *microphone);

/// Names of the devices that record, a line each, the system's choice first, written into `names` of `names_size` bytes.
/// Returns the bytes that all names need, with the closing zero.
size_t anyface_microphone_devices(char *names,
                                  size_t names_size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ANYFACE_MICROPHONE_H */
