//! The microphone for C and Python: `include/anyface_microphone.h`.
#![allow(clippy::missing_safety_doc)]

use std::{
    ffi::{CStr, c_char},
    panic::{AssertUnwindSafe, catch_unwind},
    ptr::null_mut,
    slice,
    time::Duration,
};

use crate::{Microphone, devices};

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
    let opened = catch_unwind(|| Microphone::open(name.as_deref()));
    let problem = match opened {
        Ok(Ok(microphone)) => {
            return Box::into_raw(Box::new(AnyfaceMicrophone {
                microphone,
                rest: Vec::new(),
                is_lost: false,
            }));
        }
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

/// Reads the sound that has arrived, without waiting. Writes at most `sample_count` samples, mono,
/// 16 kHz, -1 to 1, into `samples`. Returns how many it wrote.
///
/// `is_lost`, which may be NULL, receives 1 if the samples are silence because the device is gone,
/// else 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_microphone_read(
    microphone: *mut AnyfaceMicrophone,
    samples: *mut f32,
    sample_count: usize,
    is_lost: *mut i32,
) -> usize {
    let Some(microphone) = (unsafe { microphone.as_mut() }) else {
        return 0;
    };
    if samples.is_null() {
        return 0;
    }
    let read = AssertUnwindSafe(|| microphone.fill());
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
    fn fill(&mut self) {
        let block = self.microphone.read(Duration::ZERO);
        self.is_lost = block.is_lost;
        self.rest.extend(block.samples);
    }
}

/// Ends recording. Does nothing if `microphone` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_microphone_close(microphone: *mut AnyfaceMicrophone) {
    if !microphone.is_null() {
        let microphone = unsafe { Box::from_raw(microphone) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(microphone)));
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
                anyface_microphone_read(null_mut(), null_mut(), 1, null_mut()),
                0
            );
            assert_eq!(anyface_microphone_name(null_mut(), null_mut(), 0), 1);
        }
    }
}
