//! Live motion while somebody is speaking: the interface of every system that streams.

use std::sync::Arc;

use ndarray::Array3;

use super::{LandmarkClip, Performer};
use crate::{
    Error, Result,
    audio::SAMPLE_RATE_HZ,
    conditions::{Emotion, EmotionCurve},
    job::{ProgressFn, report},
    mesh::ibug::LANDMARKS,
    speech::frames_of,
};

/// Sends a whole sound through a stream: `samples` `[S]`, mono, 16 kHz.
///
/// There is one frame for every `1 / fps` seconds that have begun. Each frame has the emotion of its
/// own time.
///
/// # Errors
/// Those of [`MotionStream::push`] and [`MotionStream::set_emotion`]; `Cancelled`.
pub fn stream_whole(
    stream: &mut dyn MotionStream,
    samples: &[f32],
    emotion: &EmotionCurve,
    progress: ProgressFn<'_>,
) -> Result<LandmarkClip> {
    stream.push(samples)?;
    stream.finish()?;
    let fps = stream.fps();
    let mut values = Vec::new();
    let frames = frames_of(samples.len() as f64 / f64::from(SAMPLE_RATE_HZ), fps);
    loop {
        let share = stream.next_frame() as f32 / frames as f32;
        report(progress, "motion", share)?;
        stream.set_emotion(&emotion.at(stream.next_frame() as f64 / fps))?;
        match stream.pull() {
            Some(frame) => values.extend_from_slice(frame.displacements.as_flattened()),
            None => break,
        }
    }
    let shape = (values.len() / (3 * LANDMARKS), LANDMARKS, 3);
    let displacements = Array3::from_shape_vec(shape, values).expect("whole frames");
    Ok(LandmarkClip { displacements, fps })
}

/// The face at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkFrame {
    /// Number of the frame. Its time is `index / fps` seconds of the sound.
    pub index: usize,
    /// `[68][3]`, displacement from the neutral face in canonical metres.
    pub displacements: [[f32; 3]; LANDMARKS],
}

/// A performance in progress: push samples, pull frames of landmarks.
///
/// The frames are the same bit for bit however the samples were cut into pushes. Speech moves the
/// face. Under music, keystrokes, breath and noise the face rests, unless [`MotionStream::hear_all`]
/// was called.
///
/// ```
/// # use anyface::{Engine, EngineOptions};
/// # let engine = Engine::new(EngineOptions::default())?;
/// let mut stream = engine.stream()?;
/// let mut frames = 0;
/// for chunk in [0.0f32; 16_000].chunks(160) {
///     stream.push(chunk)?;
///     while let Some(frame) = stream.pull() {
///         assert_eq!(frame.index, frames);
///         frames += 1;
///     }
/// }
/// stream.finish()?;
/// assert_eq!(frames + stream.drain().len(), 25);
/// # Ok::<(), anyface::Error>(())
/// ```
pub trait MotionStream: Send {
    /// Takes samples: mono, 16 kHz, nominally in [−1, 1]. This only stores them; [`Self::pull`] does the
    /// work.
    ///
    /// # Errors
    /// `InvalidInput` after [`Self::finish`]; `Audio` for samples that are not finite, in which case none
    /// of them is taken.
    fn push(&mut self, samples: &[f32]) -> Result<()>;

    /// The next frame, or `None` until more samples have arrived.
    fn pull(&mut self) -> Option<LandmarkFrame>;

    /// Ends the sound. Silence follows, so that every frame that has begun can be pulled.
    ///
    /// # Errors
    /// `InvalidInput` the second time.
    fn finish(&mut self) -> Result<()>;

    /// Sets the emotion from the next frame on.
    ///
    /// # Errors
    /// `InvalidInput` for an emotion that is not finite.
    fn set_emotion(&mut self, emotion: &Emotion) -> Result<()>;

    /// Lets every sound move the face from here on, even singing, music and noise. Before, only speech does.
    fn hear_all(&mut self);

    /// Lets the face move as `performer` does from the next frame on, as strongly as `strength` (0 to 2), or as the
    /// model's own speaker for `None`.
    ///
    /// # Errors
    /// `InvalidInput` for a performer that this stream cannot show.
    fn set_performer(&mut self, performer: Option<Arc<Performer>>, strength: f32) -> Result<()> {
        let _ = strength;
        match performer {
            None => Ok(()),
            Some(_) => Err(Error::InvalidInput(
                "performer: expected a system whose live stream shows performers (freetalk), got another one".into(),
            )),
        }
    }

    /// Lets emotions come and go over `onset` times their own times from the next frame on. 1 is as on a
    /// face, 0 follows at once.
    fn set_onset(&mut self, onset: f32);

    /// Limits the look-ahead to `seconds`, from the first sound on. The face then moves sooner but follows
    /// the speech less surely. By default a stream looks ahead as far as it can.
    ///
    /// # Errors
    /// `InvalidInput` if the system has no look-ahead that short, or after the first sound.
    fn look_ahead(&mut self, seconds: f64) -> Result<()> {
        if seconds >= self.latency_s() {
            Ok(())
        } else {
            Err(too_short(self.latency_s(), seconds))
        }
    }

    /// Number of the frame that the next [`Self::pull`] returns.
    fn next_frame(&self) -> usize;

    /// Frames per second.
    fn fps(&self) -> f64;

    /// Seconds of sound after its own time that a frame waits for.
    fn latency_s(&self) -> f64;

    /// All frames that are ready.
    fn drain(&mut self) -> Vec<LandmarkFrame> {
        std::iter::from_fn(|| self.pull()).collect()
    }
}

/// Refuses a look-ahead that is shorter than the shortest one of a system.
pub(crate) fn too_short(least_s: f64, seconds: f64) -> Error {
    Error::InvalidInput(format!(
        "look-ahead: expected {least_s} s or more of this system, got {seconds}"
    ))
}
