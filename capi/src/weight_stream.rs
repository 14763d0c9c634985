//! Weights of shapes while somebody is speaking.

use std::{ffi::CString, ptr::null, sync::LazyLock};

use anyface::{
    conditions::EmotionCurve,
    motion::WeightStream,
    rig::{ARKIT, VISEMES},
};
use libc::c_char;

use crate::{
    engine::AnyfaceEngine, error::AnyfaceError, guard, pointer, request::AnyfaceRequest,
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
pub struct AnyfaceWeightStream {
    weights: WeightStream,
    /// The look-ahead that was requested.
    look_ahead_s: Option<f64>,
}

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
        Ok(AnyfaceWeightStream {
            weights: engine.0.weight_stream()?,
            look_ahead_s: None,
        })
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
        Ok(stream.weights.push(samples)?)
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
        let frame = stream.weights.pull();
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
            .weights
            .finish()?)
    };
    unsafe { guard::guard(error, work) }
}

/// Obeys a request from the next frame on, which is the first one of the next pull. It reads:
/// - "emotion": names and strengths that do not change over time; neutral if it is not set. "auto"
///   shows the emotion that is heard in the sound from now on, updated three times a second.
/// - "performer", a file that was learned with FreeTalk, and "performer_strength".
/// - "hear_all", a number: 1 lets every sound move the face, including singing, music and noise. It
///   stays so. Otherwise only speech does.
/// - "look_ahead_s", a number, before the first sound: limits the look-ahead to these seconds. The
///   face then moves sooner but follows the speech less surely. FreeTalk can look 0.19, 0.07 and 0 s
///   ahead. Without it a stream looks as far ahead as it can.
///
/// The request may be changed or freed afterwards.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another emotion, if the system has no look-ahead
/// that short, or for another look-ahead after the first sound.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_obey(
    stream: *mut AnyfaceWeightStream,
    request: *const AnyfaceRequest,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let stream = unsafe { pointer::handle_mut("stream", stream) }?;
        let request = unsafe { pointer::handle("request", request) }?;
        let emotion = match request.emotion() {
            EmotionCurve::Auto => None,
            _ => Some(request.named_emotion()?),
        };
        let look_ahead_s = request.options.look_ahead_s;
        if look_ahead_s != stream.look_ahead_s {
            look_ahead_s.map_or(Ok(()), |seconds| stream.weights.look_ahead(seconds))?;
            stream.look_ahead_s = look_ahead_s;
        }
        let (performer, strength) = request.performer();
        stream.weights.set_performer(performer, strength)?;
        if request.options.hears_all {
            stream.weights.hear_all();
        }
        match emotion {
            Some(emotion) => stream.weights.set_emotion(&emotion)?,
            None => stream.weights.hear_emotion(),
        }
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// How many seconds of sound after its own time a frame waits for, at most 0.2. 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_latency_s(
    stream: *const AnyfaceWeightStream,
) -> f64 {
    unsafe { stream.as_ref() }.map_or(0.0, |stream| stream.weights.latency_s())
}

/// Frees a stream that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weight_stream_free(stream: *mut AnyfaceWeightStream) {
    unsafe { guard::free(stream) }
}
