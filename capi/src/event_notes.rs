//! What of the events of a performance a face cannot show, in words.

use std::{
    ffi::{CString, c_char},
    ptr::null,
};

use crate::{
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    face::AnyfaceFace,
    guard,
    motion::AnyfaceMotion,
    pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// Sentences about events, in English. Never changes after it was made: any number of threads may read it at
/// the same time.
pub struct AnyfaceEventNotes(Vec<CString>);

/// Finds what of the events of a motion nobody will see: events behind the end of the sound, and units that
/// this face cannot show, such as brows where it has none. Long for a face that was never asked for its shapes:
/// accepts a progress handle.
///
/// `motion` is that of `anyface_motion_new()`. `progress` may be NULL. Free with `anyface_event_notes_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for motion that was not spoken, `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_event_notes_new(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    motion: *const AnyfaceMotion,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceEventNotes,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let engine = unsafe { pointer::handle("engine", engine) }?;
        let face = unsafe { pointer::handle("face", face) }?;
        let motion = unsafe { pointer::handle("motion", motion) }?;
        let performance = motion.performance().ok_or_else(|| {
            Failure::invalid("motion: expected motion that was spoken, got the caller's own")
        })?;
        let find = |watch: anyface::progress::ProgressFn<'_>| {
            engine.0.unseen_events(&face.0, performance, watch)
        };
        let found = unsafe { watched(progress, find) }?;
        let texts = found.into_iter();
        let texts = texts.map(|text| CString::new(text.replace('\0', "")).unwrap_or_default());
        unsafe { pointer::give(out, AnyfaceEventNotes(texts.collect())) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Number of sentences; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_event_notes_count(notes: *const AnyfaceEventNotes) -> usize {
    unsafe { notes.as_ref() }.map_or(0, |notes| notes.0.len())
}

/// A sentence, UTF-8; NULL from the count on, for NULL. Lives as long as the notes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_event_notes_text(
    notes: *const AnyfaceEventNotes,
    index: usize,
) -> *const c_char {
    guard::guard_or(null(), || {
        let text = unsafe { notes.as_ref() }.and_then(|notes| notes.0.get(index));
        text.map_or(null(), |text| text.as_ptr())
    })
}

/// Frees notes that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_event_notes_free(notes: *mut AnyfaceEventNotes) {
    unsafe { guard::free(notes) }
}
