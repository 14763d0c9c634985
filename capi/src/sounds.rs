//! What is said when: heard, read from files of other tools, written for them.

use std::ffi::c_char;

use anyface::{
    annotation::{Annotation, AnnotationFormat, Symbols},
    conditions::check_fps,
};

use crate::{
    audio::AnyfaceAudio,
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    guard, pointer,
    status::AnyfaceStatus,
};

/// Sounds of speech and their times: heard in a sound, or read from a file. Never changes after it was made.
pub struct AnyfaceSounds {
    annotation: Annotation,
    /// `[n][2]`, where the lips are together.
    closures: Vec<[f64; 2]>,
}

impl AnyfaceSounds {
    fn of(annotation: Annotation) -> Result<AnyfaceSounds, Failure> {
        let closures = annotation.closures()?;
        Ok(AnyfaceSounds {
            annotation,
            closures,
        })
    }
}

/// Listens to a sound: where the lips are heard to be together for p, b, m and their kin.
///
/// Free with `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_new(
    engine: *const AnyfaceEngine,
    audio: *const AnyfaceAudio,
    out: *mut *mut AnyfaceSounds,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let engine = unsafe { pointer::handle("engine", engine) }?;
        let audio = unsafe { pointer::handle("audio", audio) }?;
        let sounds = AnyfaceSounds::of(engine.0.listen(&audio.0)?)?;
        unsafe { pointer::give(out, sounds) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Sounds from a file that another tool or an artist has made: .TextGrid (Praat), .tsv or .json (Rhubarb), .pgo
/// (Papagayo), .dat (Moho), .txt (lines of start, end and label).
///
/// `path`: UTF-8. `fps`: frames per second that .dat counts, 1 to 240. Free with `anyface_sounds_free()`.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, `ANYFACE_STATUS_INVALID_INPUT` for another
/// ending, a line that cannot be read, or words alone.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_read(
    path: *const c_char,
    fps: f64,
    out: *mut *mut AnyfaceSounds,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        check_fps(fps)?;
        let path = unsafe { pointer::path("path", path) }?;
        let sounds = AnyfaceSounds::of(Annotation::read(path, fps)?)?;
        unsafe { pointer::give(out, sounds) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Writes sounds as a file of the kind that its ending names, as `anyface_sounds_read()` lists them.
///
/// `path`: UTF-8. `fps`: frames per second that .pgo and .dat count, 1 to 240.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending, `ANYFACE_STATUS_IO` if the file cannot be
/// written; then nothing is left of it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_write(
    sounds: *const AnyfaceSounds,
    path: *const c_char,
    fps: f64,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let sounds = unsafe { pointer::handle("sounds", sounds) }?;
        let path = unsafe { pointer::path("path", path) }?;
        AnnotationFormat::from_path(path)?;
        check_fps(fps)?;
        sounds.annotation.write(path, fps)?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Number `n` of intervals in which the lips are together; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_closure_count(sounds: *const AnyfaceSounds) -> usize {
    unsafe { sounds.as_ref() }.map_or(0, |sounds| sounds.closures.len())
}

/// Copies the intervals in which the lips are together into the caller's buffer, as
/// `AnyfaceMotionOptions` takes them.
///
/// `buffer`: `[n, 2]`, start and end in seconds, in rising order; `double_count` must be `n * 2`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `double_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_copy_closures(
    sounds: *const AnyfaceSounds,
    buffer: *mut f64,
    double_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let sounds = unsafe { pointer::handle("sounds", sounds) }?;
        let values = sounds.closures.as_flattened();
        unsafe { pointer::copy_out("buffer", values, buffer, double_count) }
    };
    unsafe { guard::guard(error, work) }
}

/// 1 where a phone (IPA, ARPABET, `MBP`) closes the lips as p, b and m do, else 0; 0 for NULL.
///
/// `label`: UTF-8.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_label_closes_lips(label: *const c_char) -> i32 {
    let label = unsafe { pointer::optional_text("label", label) };
    let closes = |label| Symbols::Phones.closes_lips(label);
    label.ok().flatten().is_some_and(closes).into()
}

/// Frees sounds; NULL is fine.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_free(sounds: *mut AnyfaceSounds) {
    unsafe { guard::free(sounds) }
}
