//! An emotion that is heard while somebody is speaking, for systems that hear none themselves.

use std::{collections::VecDeque, sync::Arc};

use super::{EmotionEar, EmotionEncoder, FRAME, HOP, LiveEar, LiveEmotion};
use crate::conditions::Emotion;

/// Keeps samples until they are to be heard, so that what is felt depends on how much was heard and not on when it came.
pub struct EmotionListener {
    windows: LiveEmotion,
    ear: LiveEar,
    /// From half a frame before the next instant on.
    samples: VecDeque<f32>,
    /// Instants of 10 ms that were heard.
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

    /// What is felt after the first `count` samples, or after those that have come; `count` rises from call to call.
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
