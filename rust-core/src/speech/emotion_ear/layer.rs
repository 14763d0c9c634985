//! The linear layer of an ear: turns a row of numbers for each window into the probability of each
//! emotion over time.

use ndarray::{Array1, Array2, ArrayView1};

use super::{
    affect::valence_and_arousal,
    heard_emotion::{HeardEmotion, rounded},
    neutral_voice::NeutralVoice,
};
use crate::{
    Error, Result,
    conditions::EMOTIONS,
    models::Weights,
    speech::{VoiceWindow, shown_emotion::shown},
};

/// Numbers are clamped to this many standard deviations from their mean.
const LARGEST: f64 = 6.0;
/// A window counts if more than this share of its frames has a pitch.
const LEAST_VOICED: f64 = 0.1;
/// From this share on, it counts in full.
const FULLY_VOICED: f64 = 0.3;
/// A window counts less if it is more than this far below the loudest one, nepers of power.
const QUIET: f64 = 2.0;
/// From this distance on, it does not count.
const SILENT: f64 = 3.5;
/// Weight of an assumed neutral instant, which is added to the others.
const BEFORE: f64 = 0.3;
/// Its logit for neutral.
const BEFORE_NEUTRAL: f64 = 3.0;
const WINDOW_ROWS: f64 = 200.0;
/// Weight of the whole sound. The moment has the rest.
const WHOLE_SHARE: f64 = 0.5;
/// Only every second instant of a voice is used, one in 320 ms.
pub(super) const EVERY: usize = 2;
/// Instants on either side that are averaged with an instant, about a second.
pub(super) const AROUND: usize = 3;

/// The evidence of one window.
#[derive(Clone)]
pub(super) struct Instant {
    logits: Array1<f64>,
    /// Level of the window's loud frames, nepers of power.
    loud: f64,
    /// How much voice is in the window, 0 to 1.
    voice: f64,
}

impl Instant {
    pub fn of(window: &VoiceWindow, logits: Array1<f64>) -> Instant {
        let rows = window.voiced.len() as f64;
        let voiced = window.voiced.iter().filter(|voiced| **voiced).count() as f64 / rows;
        let share = (voiced - LEAST_VOICED) / (FULLY_VOICED - LEAST_VOICED);
        Instant {
            logits,
            loud: window.loud,
            voice: share.clamp(0.0, 1.0) * rows / WINDOW_ROWS,
        }
    }

    /// The weight of the window, given the level of the loudest one.
    fn weight(&self, loudest: f64) -> f64 {
        let under = (loudest - self.loud - QUIET) / (SILENT - QUIET);
        self.voice * (1.0 - under).clamp(0.0, 1.0)
    }
}

/// Logistic regression over rows of `R` numbers.
pub(super) struct EmotionLayer {
    /// Names of the classes, all of [`EMOTIONS`], neutral among them.
    pub emotions: Vec<String>,
    /// `[R]`.
    mean: Array1<f64>,
    scale: Array1<f64>,
    /// `[R, emotions]`.
    weight: Array2<f64>,
    bias: Array1<f64>,
    /// The mean row of neutral readers, `[R]`.
    readers: Array1<f64>,
}

impl EmotionLayer {
    /// Reads `mean`, `scale`, `weight`, `bias` and `readers` of `model`, for rows of this many
    /// numbers.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has a wrong shape, a `scale` is not positive, an emotion
    /// is not one that a face can show, or neutral is not among them.
    pub fn load(
        model: &str,
        weights: &Weights,
        emotions: &[String],
        numbers: usize,
    ) -> Result<Self> {
        let wrong = |complaint: String| Error::Weights(format!("{model}: {complaint}"));
        let mut names = emotions.iter();
        if let Some(name) = names.find(|name| !EMOTIONS.contains(&name.as_str())) {
            return Err(wrong(format!(
                "config.json: emotions: expected names of {EMOTIONS:?}, got {name:?}"
            )));
        }
        if !emotions.iter().any(|name| *name == EMOTIONS[0]) {
            return Err(wrong(format!(
                "config.json: emotions: expected {} among them",
                EMOTIONS[0]
            )));
        }
        let vector = |name: &str, length| -> Result<Array1<f64>> {
            Ok(weights.vector(name, length)?.mapv(f64::from))
        };
        let scale = vector("scale", numbers)?;
        if let Some(value) = scale.iter().find(|value| **value <= 0.0) {
            return Err(wrong(format!("scale: expected more than 0, got {value}")));
        }
        Ok(EmotionLayer {
            mean: vector("mean", numbers)?,
            scale,
            weight: weights
                .matrix("weight", numbers, emotions.len())?
                .mapv(f64::from),
            bias: vector("bias", emotions.len())?,
            readers: vector("readers", numbers)?,
            emotions: emotions.to_vec(),
        })
    }

    /// Logits of the emotions for one row, `[emotions]`.
    pub fn logits(&self, mut row: Array1<f64>, neutral: Option<&NeutralVoice>) -> Array1<f64> {
        if let Some(neutral) = neutral {
            row += &neutral.offset;
        }
        let x = (row - &self.mean) / &self.scale;
        x.mapv(|x| x.clamp(-LARGEST, LARGEST)).dot(&self.weight) + &self.bias
    }

    /// How likely each emotion is at each window of a voice. `rows` has one row for each window.
    ///
    /// The logits of an instant are the mean of two averages: one over the second before and after
    /// it, and one over the whole sound. In both, windows with little voice count little. The rule
    /// is ours.
    pub fn heard(
        &self,
        windows: &[VoiceWindow],
        rows: impl Iterator<Item = Array1<f64>>,
        neutral: Option<&NeutralVoice>,
    ) -> HeardEmotion {
        let instant = |(window, row)| Instant::of(window, self.logits(row, neutral));
        let instants: Vec<_> = windows.iter().zip(rows).map(instant).collect();
        let shares = self.shares(&instants);
        let of = |name: &String| {
            let place = place_of(name);
            let values = shares.iter().map(|at| rounded(at[place])).collect();
            (name.clone(), values)
        };
        let along = |axis: usize| {
            let all = shares.iter().map(valence_and_arousal);
            all.map(|at| rounded(at[axis])).collect()
        };
        let intensity = |at| rounded(shown(at).intensity.into());
        HeardEmotion {
            time_s: windows
                .iter()
                .map(|window| rounded(window.middle_s))
                .collect(),
            probability: self.emotions.iter().map(of).collect(),
            intensity: shares.iter().map(intensity).collect(),
            valence: along(0),
            arousal: along(1),
        }
    }

    /// How a speaker sounds without emotion, from the windows of such a recording and their rows.
    ///
    /// # Errors
    /// `Audio` if nobody speaks in it.
    pub fn neutral_voice(
        &self,
        windows: &[VoiceWindow],
        rows: impl Iterator<Item = Array1<f64>>,
    ) -> Result<NeutralVoice> {
        let loudest = loudest(windows.iter().map(|window| window.loud));
        let weight = |window: &VoiceWindow| Instant::of(window, Array1::zeros(0)).weight(loudest);
        let weighed = windows.iter().map(weight).zip(rows);
        NeutralVoice::of_rows(weighed.filter(|(weight, _)| *weight > 0.0), &self.readers)
    }

    /// Probabilities of [`EMOTIONS`] at each instant of a whole sound.
    pub fn shares(&self, instants: &[Instant]) -> Vec<[f64; EMOTIONS.len()]> {
        let loudest = loudest(instants.iter().map(|instant| instant.loud));
        let whole = self.evidence(instants.iter(), loudest);
        let at = |k: usize| {
            let around = k.saturating_sub(AROUND)..(k + AROUND + 1).min(instants.len());
            self.probabilities(&self.evidence(instants[around].iter(), loudest), &whole)
        };
        (0..instants.len()).map(at).collect()
    }

    /// Mean logits of the instants and the assumed neutral one, `[emotions]`, weighted by how much
    /// voice each contains and how loud it is.
    pub fn evidence<'a>(
        &self,
        instants: impl Iterator<Item = &'a Instant>,
        loudest: f64,
    ) -> Array1<f64> {
        let (mut sum, mut total) = (Array1::zeros(self.emotions.len()), BEFORE);
        let neutral = self.emotions.iter().position(|name| *name == EMOTIONS[0]);
        sum[neutral.expect("checked when it was loaded")] = BEFORE * BEFORE_NEUTRAL;
        for instant in instants {
            let weight = instant.weight(loudest);
            sum.scaled_add(weight, &instant.logits);
            total += weight;
        }
        sum / total
    }

    /// Probabilities of [`EMOTIONS`] from the evidence of the moment and of the whole sound,
    /// `[emotions]` each.
    pub fn probabilities(&self, near: &Array1<f64>, whole: &Array1<f64>) -> [f64; EMOTIONS.len()] {
        let logits = whole * WHOLE_SHARE + near * (1.0 - WHOLE_SHARE);
        self.by_emotion(logits.view())
    }

    fn by_emotion(&self, logits: ArrayView1<'_, f64>) -> [f64; EMOTIONS.len()] {
        let largest = logits.fold(f64::NEG_INFINITY, |a, b| a.max(*b));
        let powers = logits.mapv(|logit| (logit - largest).exp());
        let sum = powers.sum();
        let mut shares = [0.0; EMOTIONS.len()];
        for (name, power) in self.emotions.iter().zip(powers) {
            shares[place_of(name)] = power / sum;
        }
        shares
    }
}

fn loudest(levels: impl Iterator<Item = f64>) -> f64 {
    levels.fold(f64::NEG_INFINITY, f64::max)
}

/// The index of an emotion whose name was checked when the layer was loaded.
fn place_of(name: &str) -> usize {
    let place = EMOTIONS.iter().position(|known| *known == name);
    place.expect("checked when it was loaded")
}
