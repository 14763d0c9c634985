//! Clips of speech, and the corpora they come from.

use std::ops::Range;

use ndarray::{Array2, Array3};

use super::phone::Phone;
use crate::metrics;
use anyface::{
    Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
};

const MM: f64 = 1000.0;
/// Name of the recording where it appears beside the predictors.
pub(super) const RECORDED: &str = "recorded";

/// Speech and its landmark motion. Frame `t` is at second `t / fps` of the sound.
pub(super) struct Clip {
    pub name: String,
    pub waveform: Waveform,
    /// Where the sound begins in the source's own file, seconds.
    pub start_s: f64,
    /// `[T, 68, 3]`, displacements from the neutral face, canonical metres; zero if no motion was
    /// recorded.
    pub motion: Array3<f64>,
    /// `[68, 3]`, metres, up to a translation: the speaker's face at rest.
    pub speaker: Array2<f64>,
    /// The rest face that models move, ICT's, in the same form.
    pub neutral: Array2<f64>,
    /// Frames per second.
    pub fps: f64,
    /// Landmarks to compare with the recorded ones.
    pub observed: Vec<usize>,
    /// Frames to score: the longest run without a lost frame.
    pub judged: Range<usize>,
    /// Phones where they are known, timed in seconds of this clip's sound.
    pub phones: Option<Vec<Phone>>,
}

/// A source of speech.
pub(super) struct Corpus {
    pub source: String,
    /// Whether its motion was recorded. Otherwise there are only sound and phones.
    pub recorded: bool,
    /// Clips that the model never saw in training.
    pub held_out: Vec<Clip>,
    /// Some of the clips that it did see, for the baselines.
    pub training: Vec<Clip>,
}

impl Corpus {
    /// Whether its speech was synthesised by espeak-ng.
    pub(super) fn is_synthetic(&self) -> bool {
        self.source.starts_with("espeak_")
    }
}

impl Clip {
    pub(super) fn frames(&self) -> usize {
        self.motion.dim().0
    }

    /// Indices into `observed` of the landmarks for which `of` is true.
    pub(super) fn rows(&self, of: impl Fn(usize) -> bool) -> Vec<usize> {
        let observations = self.observed.iter().enumerate();
        observations
            .filter(|(_, n)| of(**n))
            .map(|(row, _)| row)
            .collect()
    }

    /// The rest face for a predictor's motion: the speaker's own for the recording, the face that
    /// models move for all others.
    pub(super) fn face(&self, predictor: &str) -> &Array2<f64> {
        if predictor == RECORDED {
            &self.speaker
        } else {
            &self.neutral
        }
    }
}

/// At most `most` of `all`, evenly spaced.
pub(super) fn spaced<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    all.iter().step_by(all.len().div_ceil(most).max(1))
}

/// The inner-lip gap, `[T]` millimetres, of motion `[T, 68, 3]` on a face `[68, 3]`, both in metres.
pub(super) fn gap_mm(face: &Array2<f64>, motion: metrics::Clip<'_>) -> Result<Vec<f64>> {
    let positions: Array3<f64> = (&motion + face) * MM;
    metrics::lip_gap(positions.view())
}

/// The inner-lip gap of a face at rest, millimetres.
pub(super) fn rest_gap_mm(face: &Array2<f64>) -> Result<f64> {
    let still = Array3::zeros((1, face.nrows(), 3));
    Ok(gap_mm(face, still.view())?[0])
}

/// The sound from `from_s` seconds on, at most `length_s` seconds long.
pub(super) fn cut(waveform: &Waveform, from_s: f64, length_s: f64) -> Waveform {
    let at = |seconds: f64| (seconds * f64::from(SAMPLE_RATE_HZ)).round() as usize;
    let count = waveform.samples.len();
    let from = at(from_s).min(count);
    let to = from.saturating_add(at(length_s)).min(count);
    Waveform {
        samples: waveform.samples[from..to].to_vec(),
    }
}
