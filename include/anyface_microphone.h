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

/// Records the device called `name`, or the system's default device if `name` is NULL. Part of a
/// name is enough if no other device has it. The system may first ask the user for permission. If
/// the device goes away, recording resumes when it is back.
///
/// Returns NULL if nothing can be recorded; `message`, of `message_size` bytes, then receives the
/// reason. Close with `anyface_microphone_close()`.
AnyfaceMicrophone *anyface_microphone_open(const char *name, char *message, size_t message_size);

/// Writes the name of the recorded device into `name`, of `name_size` bytes. Returns how many bytes
/// the whole name needs, with the closing zero.
size_t anyface_microphone_name(const AnyfaceMicrophone *microphone, char *name, size_t name_size);

/// Reads the sound that has arrived, without waiting. Writes at most `sample_count` samples, mono,
/// 16 kHz, -1 to 1, into `samples`. Returns how many it wrote.
///
/// `is_lost`, which may be NULL, receives 1 if the samples are silence because the device is gone,
/// else 0.
size_t anyface_microphone_read(AnyfaceMicrophone *microphone,
                               float *samples,
                               size_t sample_count,
                               int32_t *is_lost);

/// Ends recording. Does nothing if `microphone` is NULL.
void anyface_microphone_close(AnyfaceMicrophone *microphone);

/// Writes the names of the recording devices into `names`, of `names_size` bytes: one a line, the
/// system's default device first. Returns how many bytes all names need, with the closing zero.
size_t anyface_microphone_devices(char *names, size_t names_size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ANYFACE_MICROPHONE_H */
