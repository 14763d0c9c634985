//! Weights of shapes while somebody is speaking.

use std::{ffi::CString, ptr::null, sync::LazyLock};

use anyface::{
    motion::WeightStream,
    rig::{ARKIT, VISEMES},
};
use libc::c_char;

use crate::{
    emotion::of_strengths, engine::AnyfaceEngine, error::AnyfaceError, guard, pointer,
    status::AnyfaceStatus,
};

/// Number of ARKit's shapes in a frame of `anyface_weight_stream_pull()`.
pub const ANYFACE_LIVE_SHAPE_COUNT: usize = 52;
/// Number of Oculus's visemes in a frame of `anyface_weight_stream_pull()`.
pub const ANYFACE_LIVE_VISEME_COUNT: usize = 15;

const _: () = assert!(ARKIT.len() == ANYFACE_LIVE_SHAPE_COUNT);
const _: () = assert!(VISEMES.len() == ANYFACE_LIVE_VISEME_COUNT);

static NAMES: LazyLock<Vec<CString>> = LazyLock::new(|| {
    let names = ARKIT.iter().chain(&VISEMES);
    names.map(|name| pointer::c_text(name)).collect()
});

/// A performance in progress for characters with their own shapes: push sound, pull weights of
/// ARKit's shapes and of visemes, with blinks, moving eyes and a drifting head.
///
/// The frames are the same bit for bit, however the sound is split into pushes. Only one thread at
/// a time may use a stream.
pub struct AnyfaceWeightStream(WeightStream);

const fn moves_between_threads<T: Send>() {}
const _: () = moves_between_threads::<AnyfaceWeightStream>();

/// Starts a performance with a neutral face. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system
/// that needs the whole sound.
///
/// The stream may outlive the engine. Free with `anyface_weight_stream_free()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_new(
    engine: *const AnyfaceEngine,
    out: *mut *mut AnyfaceWeightStream,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let engine = unsafe { pointer::handle("engine", engine) }?;
        Ok(AnyfaceWeightStream(engine.0.weight_stream()?))
    };
    unsafe { guard::give(out, error, make) }
}

/// Name of a shape or viseme of a frame. It lives as long as the library is loaded.
///
/// The `ANYFACE_LIVE_SHAPE_COUNT` shapes, such as "jawOpen", come first. The
/// `ANYFACE_LIVE_VISEME_COUNT` visemes, such as "viseme_aa", follow. NULL beyond the last viseme.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_weight_stream_name(index: usize) -> *const c_char {
    guard::guard_or(null(), || pointer::lend(NAMES.get(index)))
}

/// Takes sound and only stores it. An audio thread that may allocate can call it.
///
/// `samples`: `[S]`, mono at 16 kHz, nominally -1 to 1; any number, including 0.
/// Fails with `ANYFACE_STATUS_AUDIO` for samples that are not finite, in which case none of them is
/// taken, and with `ANYFACE_STATUS_INVALID_INPUT` after `anyface_weight_stream_finish()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_push(
    stream: *mut AnyfaceWeightStream,
    samples: *const f32,
    sample_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let stream = unsafe { pointer::handle_mut("stream", stream) }?;
        let samples = unsafe { pointer::slice("samples", samples, sample_count, 1) }?;
        Ok(stream.0.push(samples)?)
    };
    unsafe { guard::guard(error, work) }
}

/// Computes the next frame if it is ready. Frame `t` is at `t / 25` seconds of the sound.
///
/// `shapes`: `[ANYFACE_LIVE_SHAPE_COUNT]`, weights of ARKit's shapes, 0 to 1, in the order of
/// `anyface_weight_stream_name()`. `visemes`: `[ANYFACE_LIVE_VISEME_COUNT]`, their weights, 0 to 1,
/// in the same order. `head`: `[3]`, rotation vector in radians: x to the subject's left, y up, z
/// to the front. `is_ready` receives 1 for a frame. It receives 0 if more sound is needed or the
/// performance is over; then nothing else is written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_pull(
    stream: *mut AnyfaceWeightStream,
    shapes: *mut f32,
    visemes: *mut f32,
    head: *mut f32,
    is_ready: *mut i32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let stream = unsafe { pointer::handle_mut("stream", stream) }?;
        pointer::check_out("is_ready", is_ready)?;
        for (name, to) in [("shapes", shapes), ("visemes", visemes), ("head", head)] {
            pointer::check_room(name, to, 1, 1)?;
        }
        let frame = stream.0.pull();
        if let Some(frame) = &frame {
            unsafe { pointer::copy_out("shapes", &frame.shapes, shapes, frame.shapes.len()) }?;
            unsafe { pointer::copy_out("visemes", &frame.visemes, visemes, frame.visemes.len()) }?;
            unsafe { pointer::copy_out("head", &frame.head, head, frame.head.len()) }?;
        }
        unsafe { is_ready.write(i32::from(frame.is_some())) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Ends the sound. Silence follows, so that every frame that has begun can be pulled.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` the second time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_finish(
    stream: *mut AnyfaceWeightStream,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        Ok(unsafe { pointer::handle_mut("stream", stream) }?
            .0
            .finish()?)
    };
    unsafe { guard::guard(error, work) }
}

/// Sets the emotion from the next frame on.
///
/// `strengths`: `[ANYFACE_EMOTION_COUNT]`, 0 or more, at most 1.5 in sum.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for other strengths.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_set_emotion(
    stream: *mut AnyfaceWeightStream,
    strengths: *const f32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let stream = unsafe { pointer::handle_mut("stream", stream) }?;
        let emotion = unsafe { of_strengths(strengths) }?;
        Ok(stream.0.set_emotion(&emotion)?)
    };
    unsafe { guard::guard(error, work) }
}

/// Shows the emotion that is heard in the sound pushed from now on. It is updated three times a
/// second, until `anyface_weight_stream_set_emotion()` sets an emotion.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_hear_emotion(
    stream: *mut AnyfaceWeightStream,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        unsafe { pointer::handle_mut("stream", stream) }?
            .0
            .hear_emotion();
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Limits the look-ahead to `seconds`. Call it before the first sound.
///
/// The face then moves sooner but follows the speech less surely. FreeTalk can look 0.19, 0.07 and
/// 0 s ahead. Without this call a stream looks as far ahead as it can.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if the system has no look-ahead that short, or after
/// the first sound.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_look_ahead(
    stream: *mut AnyfaceWeightStream,
    seconds: f64,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        unsafe { pointer::handle_mut("stream", stream) }?
            .0
            .look_ahead(seconds)?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Lets every sound move the face from the next frame on, including singing, music and noise.
/// Before this call, only speech does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_hear_all(
    stream: *mut AnyfaceWeightStream,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        unsafe { pointer::handle_mut("stream", stream) }?
            .0
            .hear_all();
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// How many seconds of sound after its own time a frame waits for, at most 0.2. 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_latency_s(
    stream: *const AnyfaceWeightStream,
) -> f64 {
    unsafe { stream.as_ref() }.map_or(0.0, |stream| stream.0.latency_s())
}

/// Frees a stream that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_free(stream: *mut AnyfaceWeightStream) {
    unsafe { guard::free(stream) }
}
