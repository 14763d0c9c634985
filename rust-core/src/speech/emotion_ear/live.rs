//! Recognises a speaker's emotion while he is speaking.

use std::{collections::VecDeque, sync::Arc};

use super::{
    EmotionEar,
    layer::{AROUND, EVERY, Instant},
};
use crate::{
    conditions::Emotion,
    speech::{VoiceWindow, shown_emotion::shown_live},
};

/// Instants that are stored and count as the whole sound, a minute and a half.
const MEMORY: usize = 300;

/// Recognises emotion as [`super::WhisperEar::heard`] does, by the small network, with two more differences. The
/// whole sound is that of the last minute and a half, and the moment is the second before now.
pub struct LiveEar {
    ear: Arc<EmotionEar>,
    /// Number of instants so far, of which one in [`EVERY`] is used.
    instants: usize,
    /// Level of the loudest window so far.
    loudest: f64,
    /// The stored instants, the newest last.
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

    /// Takes the window of up to two seconds that ends at the next instant.
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

    /// The emotion now; neutral until 0.8 s have been heard.
    pub fn emotion(&self) -> Emotion {
        let layer = &self.ear.layer;
        let whole = layer.evidence(self.heard.iter(), self.loudest);
        let newest = self.heard.iter().rev().take(AROUND + 1);
        let near = layer.evidence(newest, self.loudest);
        shown_live(&layer.probabilities(&near, &whole))
    }
}
