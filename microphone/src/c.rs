//! The microphone for C and Python: `include/anyface_microphone.h`.
#![allow(clippy::missing_safety_doc)]

use std::{
    ffi::{CStr, c_char},
    panic::{AssertUnwindSafe, catch_unwind},
    ptr::null_mut,
    slice,
    time::Duration,
};

use crate::{Microphone, MicrophoneError, Monitor, devices};

const VERSION: &CStr =
    match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => panic!("the version holds a NUL"),
    };

/// Version of the library, such as "0.1.0". It lives as long as the library is loaded. A program
/// that loads the library at run time should stop if it was made for another version.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_microphone_version() -> *const c_char {
    VERSION.as_ptr()
}

/// A device that is being recorded. It belongs to one thread at a time.
pub struct AnyfaceMicrophone {
    microphone: Microphone,
    /// Samples that did not fit into the caller's buffer at the last read.
    rest: Vec<f32>,
    is_lost: bool,
}

/// Records the device called `name`, or the system's default device if `name` is NULL. Part of a
/// name is enough if no other device has it. The system may first ask the user for permission. If
/// the device goes away, recording resumes when it is back.
///
/// Returns NULL if nothing can be recorded; `message`, of `message_size` bytes, then receives the
/// reason. Close with `anyface_microphone_close()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_microphone_open(
    name: *const c_char,
    message: *mut c_char,
    message_size: usize,
) -> *mut AnyfaceMicrophone {
    let name = (!name.is_null()).then(|| unsafe { CStr::from_ptr(name) }.to_string_lossy());
    let open = || {
        Ok(AnyfaceMicrophone {
            microphone: Microphone::open(name.as_deref())?,
            rest: Vec::new(),
            is_lost: false,
        })
    };
    unsafe { open_device(open, message, message_size) }
}

/// A new handle from `open`. If that fails, writes the reason into `message` and returns NULL.
unsafe fn open_device<T>(
    open: impl FnOnce() -> Result<T, MicrophoneError>,
    message: *mut c_char,
    message_size: usize,
) -> *mut T {
    let problem = match catch_unwind(AssertUnwindSafe(open)) {
        Ok(Ok(device)) => return Box::into_raw(Box::new(device)),
        Ok(Err(error)) => error.to_string(),
        Err(_) => "microphone: the system's sound interface failed".to_owned(),
    };
    unsafe { write_text(&problem, message, message_size) };
    null_mut()
}

/// Writes the name of the recorded device into `name`, of `name_size` bytes. Returns how many bytes
/// the whole name needs, with the closing zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_microphone_name(
    microphone: *const AnyfaceMicrophone,
    name: *mut c_char,
    name_size: usize,
) -> usize {
    let text = unsafe { microphone.as_ref() }.map_or("", |m| m.microphone.name());
    unsafe { write_text(text, name, name_size) }
}

/// Reads the sound that has arrived. If there is none, waits for at most `wait_s` seconds.
/// Writes at most `sample_count` samples, mono, 16 kHz, -1 to 1, into `samples`. Returns how many
/// it wrote.
///
/// `is_lost`, which may be NULL, receives 1 if the samples are silence because the device is gone,
/// else 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_microphone_read(
    microphone: *mut AnyfaceMicrophone,
    samples: *mut f32,
    sample_count: usize,
    wait_s: f64,
    is_lost: *mut i32,
) -> usize {
    let Some(microphone) = (unsafe { microphone.as_mut() }) else {
        return 0;
    };
    if samples.is_null() {
        return 0;
    }
    let patience = Duration::try_from_secs_f64(wait_s).unwrap_or_default();
    let read = AssertUnwindSafe(|| microphone.fill(patience));
    let _ = catch_unwind(read);
    let count = sample_count.min(microphone.rest.len());
    let out = unsafe { slice::from_raw_parts_mut(samples, count) };
    out.copy_from_slice(&microphone.rest[..count]);
    microphone.rest.drain(..count);
    if let Some(to) = unsafe { is_lost.as_mut() } {
        *to = i32::from(microphone.is_lost);
    }
    count
}

impl AnyfaceMicrophone {
    /// Adds what has arrived to the rest. Waits only where there is no rest.
    fn fill(&mut self, patience: Duration) {
        let has_rest = !self.rest.is_empty();
        let patience = if has_rest { Duration::ZERO } else { patience };
        let block = self.microphone.read(patience);
        self.is_lost = block.is_lost;
        self.rest.extend(block.samples);
    }
}

/// Ends recording. Does nothing if `microphone` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_microphone_close(microphone: *mut AnyfaceMicrophone) {
    unsafe { close_device(microphone) }
}

unsafe fn close_device<T>(device: *mut T) {
    if !device.is_null() {
        let device = unsafe { Box::from_raw(device) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(device)));
    }
}

/// Writes the names of the recording devices into `names`, of `names_size` bytes: one a line, the
/// system's default device first. Returns how many bytes all names need, with the closing zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_microphone_devices(
    names: *mut c_char,
    names_size: usize,
) -> usize {
    let text = catch_unwind(|| devices().join("\n")).unwrap_or_default();
    unsafe { write_text(&text, names, names_size) }
}

/// Loudspeakers that play sound late. It belongs to one thread at a time.
pub struct AnyfaceMonitor {
    monitor: Monitor,
}

/// Opens the system's default loudspeakers. Sound is heard `delay_s` seconds after it was pushed,
/// so that it fits a face that follows it.
///
/// Returns NULL if nothing can be played; `message`, of `message_size` bytes, then receives the
/// reason. Close with `anyface_monitor_close()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_monitor_open(
    delay_s: f64,
    message: *mut c_char,
    message_size: usize,
) -> *mut AnyfaceMonitor {
    let open = || {
        Ok(AnyfaceMonitor {
            monitor: Monitor::open(delay_s)?,
        })
    };
    unsafe { open_device(open, message, message_size) }
}

/// Writes the name of the loudspeakers into `name`, of `name_size` bytes. Returns how many bytes
/// the whole name needs, with the closing zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_monitor_name(
    monitor: *const AnyfaceMonitor,
    name: *mut c_char,
    name_size: usize,
) -> usize {
    let text = unsafe { monitor.as_ref() }.map_or("", |m| m.monitor.name());
    unsafe { write_text(text, name, name_size) }
}

/// Queues `sample_count` samples, mono, 16 kHz, -1 to 1, to be played after those pushed before.
/// Copies them and does not wait.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_monitor_push(
    monitor: *mut AnyfaceMonitor,
    samples: *const f32,
    sample_count: usize,
) {
    let Some(monitor) = (unsafe { monitor.as_mut() }) else {
        return;
    };
    if samples.is_null() {
        return;
    }
    let samples = unsafe { slice::from_raw_parts(samples, sample_count) };
    let _ = catch_unwind(AssertUnwindSafe(|| monitor.monitor.push(samples)));
}

/// Returns 1 while sound is playing. Returns 0 while it waits for the delay, and once all has been
/// played.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_monitor_is_playing(monitor: *const AnyfaceMonitor) -> i32 {
    unsafe { monitor.as_ref() }.map_or(0, |m| i32::from(m.monitor.is_playing()))
}

/// Ends playback. Does nothing if `monitor` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_monitor_close(monitor: *mut AnyfaceMonitor) {
    unsafe { close_device(monitor) }
}

/// Writes as much of `text` as fits, and a closing zero. Returns how many bytes the whole text
/// needs, with the zero.
unsafe fn write_text(text: &str, to: *mut c_char, size: usize) -> usize {
    if !to.is_null() && size > 0 {
        let mut end = text.len().min(size - 1);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let to = unsafe { slice::from_raw_parts_mut(to.cast::<u8>(), end + 1) };
        to[..end].copy_from_slice(&text.as_bytes()[..end]);
        to[end] = 0;
    }
    text.len() + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_cut_between_letters() {
        let mut room = [1 as c_char; 4];
        let needed = unsafe { write_text("aüb", room.as_mut_ptr(), 3) };
        assert_eq!(needed, 5);
        assert_eq!(unsafe { CStr::from_ptr(room.as_ptr()) }, c"a");
        assert_eq!(unsafe { write_text("aüb", null_mut(), 0) }, 5);
    }

    #[test]
    fn nothing_happens_for_null() {
        unsafe {
            anyface_microphone_close(null_mut());
            assert_eq!(
                anyface_microphone_read(null_mut(), null_mut(), 1, 0.0, null_mut()),
                0
            );
            assert_eq!(anyface_microphone_name(null_mut(), null_mut(), 0), 1);
            anyface_monitor_close(null_mut());
            anyface_monitor_push(null_mut(), [0.0].as_ptr(), 1);
            assert_eq!(anyface_monitor_is_playing(null_mut()), 0);
            assert_eq!(anyface_monitor_name(null_mut(), null_mut(), 0), 1);
        }
    }
}
