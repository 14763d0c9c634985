//! Recognises emotion while somebody is speaking, for systems that do not do so themselves.

use std::{collections::VecDeque, sync::Arc};

use super::{EmotionEar, EmotionEncoder, FRAME, HOP, LiveEar, LiveEmotion};
use crate::conditions::Emotion;

/// Stores samples until they are needed, so that the emotion depends on how much sound was used and
/// not on when it arrived.
pub struct EmotionListener {
    windows: LiveEmotion,
    ear: LiveEar,
    /// Samples from half a frame before the next instant onwards.
    samples: VecDeque<f32>,
    /// Number of instants so far, one every 10 ms.
    instants: u64,
}

impl EmotionListener {
    /// Before any sound.
    pub fn new(encoder: Arc<EmotionEncoder>, ear: Arc<EmotionEar>) -> EmotionListener {
        EmotionListener {
            windows: LiveEmotion::new(encoder),
            ear: LiveEar::new(ear),
            samples: VecDeque::from([0.0; FRAME / 2]),
            instants: 0,
        }
    }

    /// Takes samples, mono, 16 kHz, and keeps them.
    pub fn push(&mut self, samples: &[f32]) {
        self.samples.extend(samples);
    }

    /// The emotion after the first `count` samples, or after all that have arrived if there are
    /// fewer. `count` must rise from call to call.
    pub fn emotion_after(&mut self, count: u64) -> Emotion {
        while self.samples.len() >= FRAME
            && self.instants * HOP as u64 + (FRAME / 2) as u64 <= count
        {
            let mut stretch = [0.0; FRAME];
            for (to, from) in stretch.iter_mut().zip(&self.samples) {
                *to = *from;
            }
            self.samples.drain(..HOP);
            self.instants += 1;
            if let Some(window) = self.windows.hear(&stretch) {
                self.ear.hear(&window);
            }
        }
        self.ear.emotion()
    }
}
