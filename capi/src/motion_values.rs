//! Reads the frames, head, eyes and tongue of a motion, as numbers and as a file.

use anyface::{motion::FaceModes, systems::Ability};
use libc::c_char;

use crate::{
    engine::AnyfaceEngine,
    error::AnyfaceError,
    face::AnyfaceFace,
    guard,
    motion::{AnyfaceMotion, MotionSource},
    pointer::{self, handles},
    status::AnyfaceStatus,
};

/// Number `T` of frames; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_frame_count(motion: *const AnyfaceMotion) -> usize {
    unsafe { motion.as_ref() }.map_or(0, |motion| motion.motion().frames())
}

/// Frames per second; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_fps(motion: *const AnyfaceMotion) -> f64 {
    unsafe { motion.as_ref() }.map_or(0.0, |motion| motion.motion().fps())
}

/// The emotion that was heard in the voice, as JSON: the same object as in the command's reports.
///
/// `time_s` lists instants in seconds. For each instant there are the `probability` of every
/// emotion by name, the `intensity` that is shown, and `valence` and `arousal`, -1 to 1, which are
/// derived from the probabilities. NULL if the motion does not depend on the heard emotion, or for
/// NULL. Lives as long as the motion.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_heard_emotion(
    motion: *const AnyfaceMotion,
) -> *const c_char {
    pointer::lend(unsafe { motion.as_ref() }.and_then(|motion| motion.heard_emotion.as_ref()))
}

/// Copies the displacements of landmarks into the caller's buffer.
///
/// `buffer`: `[T, 68, 3]`, canonical metres; `float_count` must be `T * 68 * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, or for motion of a system
/// that moves no landmarks.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_copy_displacements(
    motion: *const AnyfaceMotion,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = |motion: &AnyfaceMotion| {
        let displacements = &motion.landmarks()?.displacements;
        Ok(displacements.iter().copied().collect())
    };
    unsafe { AnyfaceMotion::copy(motion, buffer, float_count, error, values) }
}

/// Copies how much emotion counts compared with speech in one frame, for each vertex of a face. It
/// shows where the face expresses emotion and where it speaks.
///
/// `frame`: below `T`. `buffer`: `[V]`, 0 to 1, and 0 at vertices that do not follow the skin;
/// `float_count` must be `V`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, for a frame out of range,
/// for a motion that the caller brought or that was redone or cut from another one, or if the
/// system of the engine or of the motion does not separate emotion from speech: see
/// `anyface_describe()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_copy_mask(
    motion: *const AnyfaceMotion,
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    frame: usize,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let (motion, engine, face) = handles!(motion, engine, face);
        let frames = frame..frame.saturating_add(1);
        // Otherwise an engine without a mask would return that of another system's motion.
        engine.0.system().require(Ability::Emotion, "mask")?;
        let mask = motion.spoken()?.emotion_mask(&engine.0, &face.0, frames)?;
        Ok(mask.iter().copied().collect::<Vec<f32>>())
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Copies the rotation of the head into the caller's buffer. It is 0 throughout if the caller
/// brought the motion.
///
/// `buffer`: `[T, 3]`, rotation vectors in radians about canonical axes. Their origin lies between
/// the jaw's hinges. A rotation about +x nods down, one about +y turns to the subject's left, and
/// one about +z tilts to the subject's right. `float_count` must be `T * 3`. The displacements do
/// not include this rotation.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_copy_head(
    motion: *const AnyfaceMotion,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = |motion: &AnyfaceMotion| Ok(motion.life().head.iter().copied().collect());
    unsafe { AnyfaceMotion::copy(motion, buffer, float_count, error, values) }
}

/// Copies the rotation of the eyes into the caller's buffer. It is 0 throughout if the caller
/// brought the motion.
///
/// `buffer`: `[T, 2, 2]`, right eye, then left eye. Each has yaw to the subject's left and pitch
/// up, in radians relative to the head. `float_count` must be `T * 4`. The displacements of the
/// lids already follow the eyes.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_copy_gaze(
    motion: *const AnyfaceMotion,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = |motion: &AnyfaceMotion| Ok(motion.life().gaze.iter().copied().collect());
    unsafe { AnyfaceMotion::copy(motion, buffer, float_count, error, values) }
}

/// Copies the motion of the tongue into the caller's buffer.
///
/// `buffer`: `[T, 4]`, how far the tongue is from rest (0) to contact (1) at four places: tip to
/// the ridge behind the upper teeth, middle to the palate, back to the palate, tip to the upper
/// teeth. `float_count` must be `T * 4`. Clips include it if the face has a tongue that moves by
/// itself.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_copy_tongue(
    motion: *const AnyfaceMotion,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = |motion: &AnyfaceMotion| Ok(motion.life().tongue.iter().copied().collect());
    unsafe { AnyfaceMotion::copy(motion, buffer, float_count, error, values) }
}

/// Writes the motion as npz for numpy.
///
/// The file has `landmark_displacements` `[T, 68, 3]`, canonical metres, and `fps`. Motion that was
/// made from speech also has `head` `[T, 3]`, `gaze` `[T, 2, 2]` and `tongue` `[T, 4]`, with the
/// same values as the functions that copy them. Motion of weights also has `weights` `[T, S]`,
/// their `names` `[S]` and `together` `[T]`, how far the lips have to meet. Its landmarks are those
/// of the mean face.
///
/// `path`: UTF-8, ends in .npz. For motion of weights it may also end in .csv or .json, as
/// `anyface_weights_write()` writes them. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another
/// ending, or with `ANYFACE_STATUS_IO` if the file cannot be written; in that case no file is left
/// behind.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_write(
    motion: *const AnyfaceMotion,
    path: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let motion = unsafe { pointer::handle("motion", motion) }?;
        let path = unsafe { pointer::path("path", path) }?;
        let life = match &motion.source {
            MotionSource::Imported(..) => None,
            _ => Some(motion.life()),
        };
        let moved = motion.motion();
        let landmarks = moved.on_mean_face(&FaceModes::open(None)?)?;
        anyface::output::write_motion(path, moved, &landmarks, life)?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Frees a motion that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_free(motion: *mut AnyfaceMotion) {
    unsafe { guard::free(motion) }
}
