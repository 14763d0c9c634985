/*
 * A microphone for hosts that have none: mono, 16 kHz, as anyface_weight_stream_push() takes it. And
 * loudspeakers that play a sound as late as the face that follows it.
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

/// Loudspeakers that play sound late. It belongs to one thread at a time.
typedef struct AnyfaceMonitor AnyfaceMonitor;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/// Version of the library, such as "0.1.0". It lives as long as the library is loaded. A program
/// that loads the library at run time should stop if it was made for another version.
const char *anyface_microphone_version(void);

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

/// Reads the sound that has arrived. If there is none, waits for at most `wait_s` seconds.
/// Writes at most `sample_count` samples, mono, 16 kHz, -1 to 1, into `samples`. Returns how many
/// it wrote.
///
/// `is_lost`, which may be NULL, receives 1 if the samples are silence because the device is gone,
/// else 0.
size_t anyface_microphone_read(AnyfaceMicrophone *microphone,
                               float *samples,
                               size_t sample_count,
                               double wait_s,
                               int32_t *is_lost);

/// Ends recording. Does nothing if `microphone` is NULL.
void anyface_microphone_close(AnyfaceMicrophone *microphone);

/// Writes the names of the recording devices into `names`, of `names_size` bytes: one a line, the
/// system's default device first. Returns how many bytes all names need, with the closing zero.
size_t anyface_microphone_devices(char *names, size_t names_size);

/// Opens the system's default loudspeakers. Sound is heard `delay_s` seconds after it was pushed,
/// so that it fits a face that follows it.
///
/// Returns NULL if nothing can be played; `message`, of `message_size` bytes, then receives the
/// reason. Close with `anyface_monitor_close()`.
AnyfaceMonitor *anyface_monitor_open(double delay_s, char *message, size_t message_size);

/// Writes the name of the loudspeakers into `name`, of `name_size` bytes. Returns how many bytes
/// the whole name needs, with the closing zero.
size_t anyface_monitor_name(const AnyfaceMonitor *monitor, char *name, size_t name_size);

/// Queues `sample_count` samples, mono, 16 kHz, -1 to 1, to be played after those pushed before.
/// Copies them and does not wait.
void anyface_monitor_push(AnyfaceMonitor *monitor, const float *samples, size_t sample_count);

/// Returns 1 while sound is playing. Returns 0 while it waits for the delay, and once all has been
/// played.
int32_t anyface_monitor_is_playing(const AnyfaceMonitor *monitor);

/// Ends playback. Does nothing if `monitor` is NULL.
void anyface_monitor_close(AnyfaceMonitor *monitor);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ANYFACE_MICROPHONE_H */
