//! Motion while somebody is speaking: samples in, frames out.

use anyface::{mesh::ibug::LANDMARKS, motion::MotionStream};

use crate::{
    engine::AnyfaceEngine, error::AnyfaceError, guard, pointer, request::AnyfaceRequest,
    status::AnyfaceStatus,
};

/// A performance in progress: push sound, pull frames of the 68 landmarks in the canonical frame.
///
/// The frames are the same bit for bit, however the sound is split into pushes. Only one thread at
/// a time may use a stream.
pub struct AnyfaceStream {
    motion: Box<dyn MotionStream>,
    /// The look-ahead that was requested.
    look_ahead_s: Option<f64>,
}

const fn moves_between_threads<T: Send>() {}
const _: () = moves_between_threads::<AnyfaceStream>();

const FRAME_FLOATS: usize = LANDMARKS * 3;

/// Starts a performance with a neutral face. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system
/// that needs the whole sound.
///
/// The stream may outlive the engine. Free with `anyface_stream_free()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_stream_new(
    engine: *const AnyfaceEngine,
    out: *mut *mut AnyfaceStream,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let engine = unsafe { pointer::handle("engine", engine) }?;
        Ok(AnyfaceStream {
            motion: engine.0.stream()?,
            look_ahead_s: None,
        })
    };
    unsafe { guard::give(out, error, make) }
}

/// Takes sound and only stores it. An audio thread that may allocate can call it.
///
/// `samples`: `[S]`, mono at 16 kHz, nominally -1 to 1; any number, including 0.
/// Fails with `ANYFACE_STATUS_AUDIO` for samples that are not finite, in which case none of them is
/// taken, and with `ANYFACE_STATUS_INVALID_INPUT` after `anyface_stream_finish()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_stream_push(
    stream: *mut AnyfaceStream,
    samples: *const f32,
    sample_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let stream = unsafe { pointer::handle_mut("stream", stream) }?;
        let samples = unsafe { pointer::slice("samples", samples, sample_count, 1) }?;
        Ok(stream.motion.push(samples)?)
    };
    unsafe { guard::guard(error, work) }
}

/// Computes the frames that are ready, at most as many as the buffer has room for.
///
/// `buffer`: `[frame_room, 68, 3]`, displacements from the neutral face in metres. Frame `t` of the
/// stream, counted over all pulls, is at `t / 25` seconds of the sound.
/// `frame_count` receives the number of frames written. It is 0 if more sound is needed or the
/// performance is over.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_stream_pull(
    stream: *mut AnyfaceStream,
    buffer: *mut f32,
    frame_room: usize,
    frame_count: *mut usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let stream = unsafe { pointer::handle_mut("stream", stream) }?;
        pointer::check_out("frame_count", frame_count)?;
        pointer::check_room("buffer", buffer, frame_room, FRAME_FLOATS)?;
        let mut written = 0;
        while written < frame_room {
            let Some(frame) = stream.motion.pull() else {
                break;
            };
            if frame
                .displacements
                .as_flattened()
                .iter()
                .any(|x| !x.is_finite())
            {
                let message = format!("stream: frame {} is not finite", frame.index);
                return Err(anyface::Error::Numerics(message).into());
            }
            let (values, to) = (
                frame.displacements.as_flattened(),
                buffer.wrapping_add(written * FRAME_FLOATS),
            );
            unsafe { pointer::copy_out("buffer", values, to, FRAME_FLOATS) }?;
            written += 1;
        }
        unsafe { frame_count.write(written) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Ends the sound. Silence follows, so that every frame that has begun can be pulled.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` the second time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_stream_finish(
    stream: *mut AnyfaceStream,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        Ok(unsafe { pointer::handle_mut("stream", stream) }?
            .motion
            .finish()?)
    };
    unsafe { guard::guard(error, work) }
}

/// Obeys a request from the next frame on, which is the first one of the next pull. It reads:
/// - "emotion": names and strengths that do not change over time; neutral if it is not set.
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
pub unsafe extern "C" fn anyface_stream_obey(
    stream: *mut AnyfaceStream,
    request: *const AnyfaceRequest,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let stream = unsafe { pointer::handle_mut("stream", stream) }?;
        let request = unsafe { pointer::handle("request", request) }?;
        let emotion = request.named_emotion()?;
        let look_ahead_s = request.options.look_ahead_s;
        if look_ahead_s != stream.look_ahead_s {
            look_ahead_s.map_or(Ok(()), |seconds| stream.motion.look_ahead(seconds))?;
            stream.look_ahead_s = look_ahead_s;
        }
        let (performer, strength) = request.performer();
        stream.motion.set_performer(performer, strength)?;
        if request.options.hears_all {
            stream.motion.hear_all();
        }
        Ok(stream.motion.set_emotion(&emotion)?)
    };
    unsafe { guard::guard(error, work) }
}

/// How many seconds of sound after its own time a frame waits for, at most 0.2. 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_stream_latency_s(stream: *const AnyfaceStream) -> f64 {
    unsafe { stream.as_ref() }.map_or(0.0, |stream| stream.motion.latency_s())
}

/// Frees a stream that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_stream_free(stream: *mut AnyfaceStream) {
    unsafe { guard::free(stream) }
}
