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

/// Number of ARKit's shapes and of Oculus' visemes in a frame of `anyface_weight_stream_pull()`.
pub const ANYFACE_LIVE_SHAPE_COUNT: usize = 52;
pub const ANYFACE_LIVE_VISEME_COUNT: usize = 15;

const _: () = assert!(ARKIT.len() == ANYFACE_LIVE_SHAPE_COUNT);
const _: () = assert!(VISEMES.len() == ANYFACE_LIVE_VISEME_COUNT);

static NAMES: LazyLock<Vec<CString>> = LazyLock::new(|| {
    let names = ARKIT.iter().chain(&VISEMES);
    names.map(|name| pointer::c_text(name)).collect()
});

/// A performance in progress for characters with shapes of their own: push sound, pull weights of ARKit's shapes and of
/// visemes, with blinks, eyes that move and a head that drifts.
///
/// The frames are the same bit for bit however the sound is cut into pushes. A stream belongs to
/// one thread at a time.
pub struct AnyfaceWeightStream(WeightStream);

const fn moves_between_threads<T: Send>() {}
const _: () = moves_between_threads::<AnyfaceWeightStream>();

/// Starts a performance with a neutral face. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system that
/// needs the whole sound.
///
/// It may outlive the engine. Free with `anyface_weight_stream_free()`.
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

/// Name of one of the `ANYFACE_LIVE_SHAPE_COUNT` shapes of a frame, such as "jawOpen", and behind them of its
/// `ANYFACE_LIVE_VISEME_COUNT` visemes, such as "viseme_aa"; NULL from the last one on. Lives as long as the library is loaded.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_weight_stream_name(index: usize) -> *const c_char {
    guard::guard_or(null(), || pointer::lend(NAMES.get(index)))
}

/// Takes sound and only keeps it: fit for an audio thread that may allocate.
///
/// `samples`: `[S]`, mono at 16 kHz, nominally -1 to 1; any number, also none.
/// Fails with `ANYFACE_STATUS_AUDIO` for samples that are not finite, of which none is then taken,
/// `ANYFACE_STATUS_INVALID_INPUT` after `anyface_weight_stream_finish()`.
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

/// Computes the next frame where it is ready; frame `t` stands at `t / 25` seconds of the sound.
///
/// `shapes`: `[ANYFACE_LIVE_SHAPE_COUNT]`, weights of ARKit's shapes, 0 to 1, in the order of `anyface_weight_stream_name()`.
/// `visemes`: `[ANYFACE_LIVE_VISEME_COUNT]`, 0 to 1, in the same order. `head`: `[3]`, rotation vector in
/// radians: x to the subject's left, y up, z to the front.
/// `is_ready` receives 1, or 0 where more sound is needed or the performance is over; then nothing else is written.
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

/// Ends the sound: silence follows, and every frame that began can be pulled.
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

/// Emotion from the next frame on.
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

/// Shows the emotion that is heard in what is pushed from now on, three times a second anew, until
/// `anyface_weight_stream_set_emotion()` sets one.
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

/// Looks ahead by `seconds` at most from the first sound on: the face is sooner, and less sure of what it says. FreeTalk can
/// look 0.19, 0.07 and 0 s ahead; without this a stream looks as far ahead as it can.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if no look-ahead of the system is so short, or after the first sound.
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

/// Lets every sound move the face from the next frame on, singing, music and noise too; before, speech alone does.
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

/// Seconds of sound after a frame's own instant that it waits for, at most 0.2; 0 for NULL.
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
