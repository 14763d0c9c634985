//! The result of an ear: the probability of each emotion over time, and what a face shows of it.

use std::{collections::BTreeMap, ops::Range};

use crate::{
    conditions::{EMOTIONS, Emotion, EmotionCurve},
    speech::shown_emotion::{shown, shown_on_purpose},
};

/// How likely each emotion is over time.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct HeardEmotion {
    /// The middle of the window of sound at each instant, seconds.
    pub time_s: Vec<f64>,
    /// Probabilities at these instants of the emotions in the ear's training data, by name.
    pub probability: BTreeMap<String, Vec<f64>>,
    /// How strongly a face shows the emotion at these instants: 0 where neutral is as likely as it
    /// is for strangers who read aloud.
    pub intensity: Vec<f64>,
    /// How pleasant the emotion is at these instants, −1 to 1: the mean of people's ratings of each
    /// emotion, weighted by the probabilities. Like `arousal`, it is derived from the probabilities
    /// and not measured by itself.
    pub valence: Vec<f64>,
    /// How excited the emotion is at these instants, −1 to 1.
    pub arousal: Vec<f64>,
}

impl HeardEmotion {
    /// One JSON object, as in reports.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("numbers and names")
    }

    /// What a face shows of it: nothing where neutral is as likely as it is for strangers who read
    /// aloud, and little where neutral is only slightly less likely.
    pub fn curve(&self) -> EmotionCurve {
        self.curve_of(shown)
    }

    /// What a face shows of a recording that was chosen for its emotion. The intensity is how
    /// unlikely neutral is.
    pub fn curve_on_purpose(&self) -> EmotionCurve {
        self.curve_of(shown_on_purpose)
    }

    /// The same emotion with the intensity of a recording that was chosen for it.
    #[must_use]
    pub(in crate::speech) fn on_purpose(mut self) -> HeardEmotion {
        let intensity = |k| rounded(shown_on_purpose(&self.shares(k)).intensity.into());
        self.intensity = (0..self.time_s.len()).map(intensity).collect();
        self
    }

    fn curve_of(&self, shown: fn(&[f64; EMOTIONS.len()]) -> Emotion) -> EmotionCurve {
        if self.time_s.is_empty() {
            return EmotionCurve::default();
        }
        let keys = self.time_s.iter().enumerate();
        EmotionCurve::Keys(
            keys.map(|(k, time_s)| (*time_s, shown(&self.shares(k))))
                .collect(),
        )
    }

    /// Probabilities of [`EMOTIONS`] at an instant.
    pub(super) fn shares(&self, k: usize) -> [f64; EMOTIONS.len()] {
        EMOTIONS.map(|name| self.probability.get(name).map_or(0.0, |of| of[k]))
    }

    /// The part whose instants lie in a span of seconds.
    #[must_use]
    pub fn between(&self, span_s: Range<f64>) -> HeardEmotion {
        let first = self.time_s.partition_point(|time_s| *time_s < span_s.start);
        let end = self
            .time_s
            .partition_point(|time_s| *time_s < span_s.end)
            .max(first);
        let cut = |values: &[f64]| values[first..end].to_vec();
        let probability = self.probability.iter();
        HeardEmotion {
            time_s: cut(&self.time_s),
            probability: probability
                .map(|(name, of)| (name.clone(), cut(of)))
                .collect(),
            intensity: cut(&self.intensity),
            valence: cut(&self.valence),
            arousal: cut(&self.arousal),
        }
    }

    /// The same, shifted to be `by_s` seconds later.
    #[must_use]
    pub fn later(mut self, by_s: f64) -> HeardEmotion {
        self.time_s
            .iter_mut()
            .for_each(|time_s| *time_s = rounded(*time_s + by_s));
        self
    }

    /// Appends the part that follows.
    pub fn extend(&mut self, next: HeardEmotion) {
        self.time_s.extend(next.time_s);
        self.intensity.extend(next.intensity);
        self.valence.extend(next.valence);
        self.arousal.extend(next.arousal);
        for (name, of) in next.probability {
            self.probability.entry(name).or_default().extend(of);
        }
    }
}

/// Rounds to thousandths.
pub(super) fn rounded(x: f64) -> f64 {
    (x * 1e3).round() / 1e3
}
