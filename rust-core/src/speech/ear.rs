//! The ear: the first layers of Whisper base and a small trained body → features at 25 Hz.
//!
//! Twin of `training/speech/ear.py`; a golden file checks that both agree. Whisper has heard
//! everyone, so its first layers are alike for all voices. The body learns what a face does with
//! them. Output frame `i` is centred on second `i / 25`.
//!
//! A long sound is encoded in spans of 12 s. Whisper's attention sees a span and 1.5 s on either
//! side of it. The body continues from span to span, so it gives the same as for the whole sound at
//! once. Of what lies between the two, only the rows that the next span needs stay in memory.

mod body;
mod level;

use std::{borrow::Cow, sync::Arc};

use ndarray::{Array2, ArrayRef2, Axis, concatenate, s};

pub use body::EarConfig;

use super::{
    EAR_MODEL, FeatureTrack, SpeechEncoder,
    whisper::LEAST_SAMPLES,
    whisper_trunk::{WhisperTrunk, features_of},
};
use crate::{
    Error, Result,
    audio::Waveform,
    job::ProgressFn,
    models::{ModelFiles, Weights},
};
use body::{EarBody, FEATURES_EACH};
pub(super) use level::ear_mel;

/// Memory that the ear takes while it is loaded and listens to some seconds, bytes. Most of it is 10.4
/// million weights of the trunk in single precision.
pub(crate) const EAR_BYTES: u64 = 76 << 20;

/// The speech encoder on Whisper's first layers.
pub struct Ear {
    trunk: Arc<WhisperTrunk>,
    body: EarBody,
}

impl Ear {
    /// From Whisper's layers and the files of `ear`.
    ///
    /// # Errors
    /// `Weights` if the files are damaged or do not fit the layers.
    pub(super) fn load(trunk: Arc<WhisperTrunk>, body: &ModelFiles) -> Result<Self> {
        let body = EarBody::load(&Weights::from_bytes(&body.weights)?, &body.config)?;
        body.config().check(trunk.channels(), trunk.layers())?;
        Ok(Ear { trunk, body })
    }

    /// Features of a levelled log-mel, `[T, 80]` at 100 Hz. Returns `[⌈⌈T/2⌉/2⌉, C]`.
    fn forward(&self, mel: &ArrayRef2<f32>, progress: ProgressFn<'_>) -> Result<Array2<f32>> {
        let total = features_of(mel.nrows());
        let mut walk = Walk::new(&self.body, total);
        let taps = &self.body.config().taps;
        self.trunk.hear(mel, taps, progress, |rows, outputs| {
            walk.add(&outputs, rows.end == total);
        })?;
        Ok(walk.features)
    }
}

/// The way of the body through a sound whose spans arrive in the order of time.
struct Walk<'a> {
    body: &'a EarBody,
    /// Rows at 50 Hz that enter the body's convolutions, `[T, C]`.
    rows: Array2<f32>,
    /// Output frame at which `rows` starts.
    first: usize,
    /// Number of finished output frames.
    done: usize,
    /// `[frames, C]`, of the whole sound.
    features: Array2<f32>,
}

impl<'a> Walk<'a> {
    /// `total`: rows at 50 Hz of the whole sound.
    fn new(body: &'a EarBody, total: usize) -> Self {
        let channels = body.config().channels;
        Walk {
            body,
            rows: Array2::zeros((0, channels)),
            first: 0,
            done: 0,
            features: Array2::zeros((total.div_ceil(FEATURES_EACH), channels)),
        }
    }

    /// Takes the trunk's outputs for the next rows, and finishes all frames whose context is there.
    fn add(&mut self, outputs: &[Array2<f32>], is_last: bool) {
        let context = self.body.context();
        let rows = self.body.enter(outputs);
        self.rows = concatenate(Axis(0), &[self.rows.view(), rows.view()]).expect("equal widths");
        let here = self.first + self.rows.nrows() / FEATURES_EACH;
        let end = if is_last {
            self.features.nrows()
        } else {
            here.saturating_sub(context).max(self.done)
        };
        let features = self.body.forward(&self.rows);
        let (from, to) = (self.done - self.first, end - self.first);
        let finished = features.slice(s![from..to, ..]);
        self.features
            .slice_mut(s![self.done..end, ..])
            .assign(&finished);
        let next = end.saturating_sub(context).max(self.first);
        let unneeded = (FEATURES_EACH * (next - self.first)).min(self.rows.nrows());
        self.rows = self.rows.slice(s![unneeded.., ..]).to_owned();
        (self.first, self.done) = (next, end);
    }
}

impl SpeechEncoder for Ear {
    fn name(&self) -> &'static str {
        EAR_MODEL.name
    }

    fn channels(&self) -> usize {
        self.body.config().channels
    }

    /// Encodes a waveform. A sound shorter than 25 ms is continued with silence to that length.
    fn encode(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<FeatureTrack> {
        if waveform.samples.is_empty() {
            return Err(Error::Audio("expected sound, got no samples".into()));
        }
        let mel = ear_mel(&long_enough(&waveform.samples));
        Ok(FeatureTrack {
            features: self.forward(&mel, progress)?,
            rate_hz: self.body.config().rate_hz,
            first_s: 0.0,
        })
    }
}

fn long_enough(samples: &[f32]) -> Cow<'_, [f32]> {
    if samples.len() < LEAST_SAMPLES {
        let mut padded = samples.to_vec();
        padded.resize(LEAST_SAMPLES, 0.0);
        padded.into()
    } else {
        samples.into()
    }
}

#[cfg(test)]
mod tests;
