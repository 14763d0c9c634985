//! One recorded performance and the corpora they come from.

use ndarray::{Array2, Array3};

use crate::audio::{SAMPLE_RATE_HZ, Waveform};

/// Speech and the landmark motion that belongs to it; frame `t` is second `t / fps` of the sound.
pub(super) struct Clip {
    pub name: String,
    pub waveform: Waveform,
    /// `[T, 68, 3]`, displacement from the neutral face, canonical metres.
    pub motion: Array3<f64>,
    /// `[68, 3]`, metres, up to a translation.
    pub neutral: Array2<f64>,
    /// Frames per second.
    pub fps: f64,
    /// Landmarks that the recording saw.
    pub observed: Vec<usize>,
    /// `[T]`, the captured jawOpen weight, where there is one.
    pub jaw: Option<Vec<f64>>,
}

/// A source of recorded motion.
pub(super) struct Corpus {
    pub source: &'static str,
    /// What the model never saw.
    pub held_out: Vec<Clip>,
    /// Some of what it did see, for the baselines.
    pub training: Vec<Clip>,
}

impl Clip {
    pub(super) fn frames(&self) -> usize {
        self.motion.dim().0
    }
}

/// The sound from `from_s` seconds on, at most `length_s` long.
pub(super) fn cut(waveform: &Waveform, from_s: f64, length_s: f64) -> Waveform {
    let at = |seconds: f64| (seconds * f64::from(SAMPLE_RATE_HZ)).round() as usize;
    let count = waveform.samples.len();
    let from = at(from_s).min(count);
    let to = from.saturating_add(at(length_s)).min(count);
    Waveform {
        samples: waveform.samples[from..to].to_vec(),
    }
}
