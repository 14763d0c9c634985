//! Emotions by name.

use anyface::conditions::Emotion;
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    guard, pointer,
    status::AnyfaceStatus,
    version::ANYFACE_EMOTION_COUNT,
};

/// Reads an emotion from its strengths, `[ANYFACE_EMOTION_COUNT]`.
pub(crate) unsafe fn of_strengths(strengths: *const f32) -> Result<Emotion, Failure> {
    let row = unsafe { pointer::slice("strengths", strengths, 1, ANYFACE_EMOTION_COUNT) }?;
    let row = row
        .first_chunk::<ANYFACE_EMOTION_COUNT>()
        .ok_or(Failure::Null("strengths"))?;
    Ok(Emotion::from_strengths(*row)?)
}

/// Reads emotions as text, such as "happy:0.7" or "happy:0.4,surprised:0.3".
///
/// `strengths` receives `ANYFACE_EMOTION_COUNT` values, one for each of the `emotions` of
/// `anyface_describe()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for an unknown name, a strength below 0, or strengths
/// whose sum is above 1.5.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_emotion_parse(
    text: *const c_char,
    strengths: *mut f32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let emotion = Emotion::parse(unsafe { pointer::text("text", text) }?)?;
        let values = emotion.mixture.map(|share| share * emotion.intensity);
        unsafe { pointer::copy_out("strengths", &values, strengths, values.len()) }
    };
    unsafe { guard::guard(error, work) }
}
