//! Moves the landmarks of a face by speech, by emotion, and by blinks and drift of the head.

use std::sync::Arc;

use anyface::{
    Result,
    audio::SAMPLE_RATE_HZ,
    conditions::Emotion,
    motion::{IdleMotion, MotionStream},
    rig::ARKIT,
    speech::{EmotionEar, EmotionEncoder, EmotionListener},
};

use crate::shapes::{Landmarks, Shapes, Weights};

/// Word that asks for the emotion heard in the voice.
const HEARD: &str = "auto";
/// Indices of the heights of the inner lips' middles in a frame of landmarks, upper and lower.
const LIPS: [usize; 2] = [62 * 3 + 1, 66 * 3 + 1];
/// How far an open mouth parts the lips, metres.
const OPEN_M: f32 = 0.03;

/// Motion of one frame.
pub(crate) struct Spoken {
    pub landmarks: Landmarks,
    /// Rotation vector of the head, radians, axes of the face.
    pub head: [f32; 3],
}

/// A performance in progress.
pub(crate) struct Speaker {
    motion: Box<dyn MotionStream>,
    ears: (Arc<EmotionEncoder>, Arc<EmotionEar>),
    /// Listener to the emotion, with the number of samples that had arrived before it began.
    listener: Option<(EmotionListener, u64)>,
    pushed: u64,
    shapes: Arc<Shapes>,
    idle: Option<IdleMotion>,
}

impl Speaker {
    pub fn new(
        motion: Box<dyn MotionStream>,
        ears: (Arc<EmotionEncoder>, Arc<EmotionEar>),
        shapes: Arc<Shapes>,
        (emotion, alive): (&str, bool),
    ) -> Result<Speaker> {
        let mut speaker = Speaker {
            motion,
            ears,
            listener: None,
            pushed: 0,
            shapes,
            idle: alive.then(|| IdleMotion::new(0)),
        };
        speaker.set_emotion(emotion)?;
        Ok(speaker)
    }

    /// Sets the emotion from the next frame on.
    pub fn set_emotion(&mut self, emotion: &str) -> Result<()> {
        if emotion != HEARD {
            self.listener = None;
            return self.motion.set_emotion(&Emotion::parse(emotion)?);
        }
        if self.listener.is_none() {
            let (encoder, ear) = self.ears.clone();
            self.listener = Some((EmotionListener::new(encoder, ear), self.pushed));
        }
        Ok(())
    }

    pub fn hear_all(&mut self) {
        self.motion.hear_all();
    }

    pub fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.motion.push(samples)?;
        self.pushed += samples.len() as u64;
        if let Some((listener, _)) = &mut self.listener {
            listener.push(samples);
        }
        Ok(())
    }

    pub fn finish(&mut self) -> Result<()> {
        self.motion.finish()
    }

    /// How ARKit's shapes move the landmarks.
    pub fn shapes(&self) -> &Arc<Shapes> {
        &self.shapes
    }

    pub fn fps(&self) -> f64 {
        self.motion.fps()
    }

    pub fn latency_s(&self) -> f64 {
        self.motion.latency_s()
    }

    /// The next frame, or `None` until more samples arrive.
    pub fn next(&mut self) -> Result<Option<Spoken>> {
        self.feel()?;
        let Some(frame) = self.motion.pull() else {
            return Ok(None);
        };
        let mut landmarks = [0.0; _];
        landmarks.copy_from_slice(frame.displacements.as_flattened());
        let mut head = [0.0; 3];
        if let Some(idle) = &mut self.idle {
            let parted = landmarks[LIPS[0]] - landmarks[LIPS[1]];
            let opening = (parted / OPEN_M).clamp(0.0, 1.0);
            let time_s = frame.index as f64 / self.motion.fps();
            let now = idle.at(time_s, opening.into());
            let mut weights: Weights = [0.0; _];
            for (name, closed) in ["eyeBlinkRight", "eyeBlinkLeft"].iter().zip(now.closed) {
                let blink = ARKIT.iter().position(|known| known == name);
                weights[blink.expect("ARKit has blinks")] = closed;
            }
            self.shapes.add(&weights, &mut landmarks);
            head = now.head;
        }
        Ok(Some(Spoken { landmarks, head }))
    }

    /// Sets the emotion of the next frame to the one heard up to the end of the frame's look-ahead.
    fn feel(&mut self) -> Result<()> {
        let Some((listener, before)) = &mut self.listener else {
            return Ok(());
        };
        let until_s = self.motion.next_frame() as f64 / self.motion.fps() + self.motion.latency_s();
        let until = (until_s * f64::from(SAMPLE_RATE_HZ)).round() as u64;
        let emotion = listener.emotion_after(until.saturating_sub(*before));
        self.motion.set_emotion(&emotion)
    }
}
