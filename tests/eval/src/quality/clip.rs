//! One recorded performance and the corpora they come from.

use std::ops::Range;

use ndarray::{Array2, Array3};

use super::phone::Phone;
use crate::metrics;
use anyface::{
    Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
};

const MM: f64 = 1000.0;
/// Name of the recording, where it is shown beside the predictors.
pub(super) const RECORDED: &str = "recorded";

/// Speech and the landmark motion that belongs to it; frame `t` is second `t / fps` of the sound.
pub(super) struct Clip {
    pub name: String,
    pub waveform: Waveform,
    /// Where the sound begins in the source's own file, seconds.
    pub start_s: f64,
    /// `[T, 68, 3]`, displacement from the neutral face, canonical metres; zero where none was
    /// recorded.
    pub motion: Array3<f64>,
    /// `[68, 3]`, metres, up to a translation: the face of the speaker at rest.
    pub speaker: Array2<f64>,
    /// The same of the face that models move, ICT's.
    pub neutral: Array2<f64>,
    /// Frames per second.
    pub fps: f64,
    /// Landmarks whose distance from the recorded ones is judged.
    pub observed: Vec<usize>,
    /// Frames that are judged: the longest stretch in which none was lost.
    pub judged: Range<usize>,
    /// Phones, seconds of this clip's sound, where they are known.
    pub phones: Option<Vec<Phone>>,
}

/// A source of speech.
pub(super) struct Corpus {
    pub source: String,
    /// Whether its motion was recorded; otherwise there is nothing but sound and phones.
    pub recorded: bool,
    /// What the model never saw.
    pub held_out: Vec<Clip>,
    /// Some of what it did see, for the baselines.
    pub training: Vec<Clip>,
}

impl Corpus {
    /// Whether espeak-ng spoke it.
    pub(super) fn is_synthetic(&self) -> bool {
        self.source.starts_with("espeak_")
    }
}

impl Clip {
    pub(super) fn frames(&self) -> usize {
        self.motion.dim().0
    }

    /// Rows of the landmarks that `of` takes among those that the recording saw.
    pub(super) fn rows(&self, of: impl Fn(usize) -> bool) -> Vec<usize> {
        let observations = self.observed.iter().enumerate();
        observations
            .filter(|(_, n)| of(**n))
            .map(|(row, _)| row)
            .collect()
    }

    /// The face at rest on which a predictor's motion is judged: the recording moves the speaker's,
    /// all others the one that models move.
    pub(super) fn face(&self, predictor: &str) -> &Array2<f64> {
        match predictor == RECORDED {
            true => &self.speaker,
            false => &self.neutral,
        }
    }
}

/// At most `most` of `all`, at equal distances.
pub(super) fn spaced<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    all.iter().step_by(all.len().div_ceil(most).max(1))
}

/// The inner-lip gap of `[T, 68, 3]` motion of a face `[68, 3]`, metres: `[T]` millimetres.
pub(super) fn gap_mm(face: &Array2<f64>, motion: metrics::Clip<'_>) -> Result<Vec<f64>> {
    let positions: Array3<f64> = (&motion + face) * MM;
    metrics::lip_gap(positions.view())
}

/// The inner-lip gap of a face at rest, millimetres.
pub(super) fn rest_gap_mm(face: &Array2<f64>) -> Result<f64> {
    let still = Array3::zeros((1, face.nrows(), 3));
    Ok(gap_mm(face, still.view())?[0])
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
