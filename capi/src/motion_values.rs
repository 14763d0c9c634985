//! What a motion holds: its frames, head and eyes, as numbers and as a file.

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

/// The emotion that was heard in the voice, as the JSON object that reports of the command have: `time_s`, seconds, and at
/// each of them the `probability` of every emotion by name, the `intensity` that is shown, and `valence` and `arousal`, -1
/// to 1, which are derived from the probabilities. NULL where the motion does not depend on it, or for NULL. Lives as long
/// as the motion.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_heard_emotion(
    motion: *const AnyfaceMotion,
) -> *const c_char {
    pointer::lend(unsafe { motion.as_ref() }.and_then(|motion| motion.heard_emotion.as_ref()))
}

/// Copies motion of landmarks into the caller's buffer.
///
/// `buffer`: `[T, 68, 3]`, canonical metres; `float_count` must be `T * 68 * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, or a system that moves no
/// landmarks.
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

/// Copies how far emotion is believed beside what is said in one frame, for each vertex of a face: where the face
/// shows the one and where the other.
///
/// `frame`: below `T`. `buffer`: `[V]`, 0 to 1, 0 where nothing of the face is followed; `float_count` must be `V`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, a frame out of range, a motion that was
/// not spoken, or where the system of the engine or of the motion does not tell both apart: see
/// `anyface_system_hears_emotion()`.
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
        // A mask of another system's motion would be the answer of an engine that has none.
        engine.0.system().require(Ability::Emotion, "mask")?;
        let mask = motion.spoken()?.emotion_mask(&engine.0, &face.0, frames)?;
        Ok(mask.iter().copied().collect::<Vec<f32>>())
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Copies the rotation of the head into the caller's buffer; 0 throughout where nothing was spoken.
///
/// `buffer`: `[T, 3]`: rotation vectors in radians about canonical axes through the origin between the
/// jaw's hinges; about +x nods down, about +y turns to the subject's left, about +z tilts to the subject's
/// right. `float_count` must be `T * 3`. The displacements do not hold it.
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

/// Copies the rotation of the eyes into the caller's buffer; 0 throughout where nothing was spoken.
///
/// `buffer`: `[T, 2, 2]`: right eye, left eye; yaw to the subject's left and pitch up, radians against the
/// head. `float_count` must be `T * 4`. The displacements of the lids follow it.
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

/// Copies what the tongue does into the caller's buffer: `[T, 4]`, shares of the way from rest to contact, 0 to 1: tip
/// to the ridge behind the upper teeth, middle and back to the palate, tip at the upper teeth. `float_count` must be
/// `T * 4`. Clips hold it where the face has a tongue that moves by itself.
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

/// Writes the motion as npz for numpy: `landmark_displacements` `[T, 68, 3]`, canonical metres, `fps`,
/// and for motion that was spoken `head` `[T, 3]`, `gaze` `[T, 2, 2]` and `tongue` `[T, 4]` as the functions that copy
/// them give them. Motion of weights has `weights` `[T, S]`, their `names` `[S]` and `together` `[T]`, how far lips have
/// to meet, too; its landmarks are the mean face's.
///
/// `path`: UTF-8, ends in .npz; for motion of weights in .csv or .json as well, as `anyface_weights_write()`
/// writes them. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending,
/// `ANYFACE_STATUS_IO` if the file cannot be written; then nothing is left of it.
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
