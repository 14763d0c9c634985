//! What is heard of somebody's emotion while he is speaking.

use std::{collections::VecDeque, sync::Arc};

use super::{
    EmotionEar,
    layer::{AROUND, EVERY, Instant},
};
use crate::{
    conditions::Emotion,
    speech::{VoiceWindow, shown_emotion::shown},
};

/// Instants that are remembered as the whole, a minute and a half.
const MEMORY: usize = 300;

/// What [`EmotionEar::emotion`] hears of the whole, but that the whole is what was heard so far, and the moment the
/// second before it.
pub struct LiveEar {
    ear: Arc<EmotionEar>,
    /// Instants that came, of which one in [`EVERY`] is heard.
    instants: usize,
    /// Level of the loudest window so far.
    loudest: f64,
    /// What was heard so far and counts, the newest last.
    heard: VecDeque<Instant>,
}

impl LiveEar {
    /// Before any sound.
    pub fn new(ear: Arc<EmotionEar>) -> LiveEar {
        LiveEar {
            instants: 0,
            loudest: f64::NEG_INFINITY,
            heard: VecDeque::with_capacity(MEMORY),
            ear,
        }
    }

    /// Hears the two seconds before an instant.
    pub fn hear(&mut self, window: &VoiceWindow) {
        self.instants += 1;
        if !(self.instants - 1).is_multiple_of(EVERY) {
            return;
        }
        if self.heard.len() == MEMORY {
            self.heard.pop_front();
        }
        self.loudest = self.loudest.max(window.loud);
        let logits = self.ear.layer.logits(self.ear.row(window), None);
        self.heard.push_back(Instant::of(window, logits));
    }

    /// What is felt now; neutral before 0.8 s were heard.
    pub fn emotion(&self) -> Emotion {
        let layer = &self.ear.layer;
        let whole = layer.evidence(self.heard.iter(), self.loudest);
        let newest = self.heard.iter().rev().take(AROUND + 1);
        let near = layer.evidence(newest, self.loudest);
        shown(&layer.probabilities(&near, &whole))
    }
}
