//! HuBERT (Hsu et al. 2021) from a user's Hugging Face folder. FreeTalk's own speech encoder.

use std::path::Path;

use super::{FeatureTrack, HiddenStates, SpeechEncoder, transformer_encoder::TransformerEncoder};
use crate::{Result, audio::Waveform, job::ProgressFn};

/// A HuBERT encoder, base (post-norm) or large (pre-norm).
pub struct Hubert {
    encoder: TransformerEncoder,
}

impl Hubert {
    /// Reads `config.json`, the weights (as [`super::from_folder`] does) and, if present,
    /// `preprocessor_config.json`.
    ///
    /// `layer` chooses a hidden state: 0 is before the first layer, `None` is the output.
    ///
    /// # Errors
    /// `Io` if a file cannot be read; `Weights` if one is damaged, they do not fit each other, or
    /// the folder holds another model; `InvalidInput` for a layer that does not exist.
    pub fn load_folder(folder: &Path, layer: Option<usize>) -> Result<Self> {
        let encoder = TransformerEncoder::load_folder(folder, "hubert", layer)?;
        Ok(Hubert { encoder })
    }

    /// Resamples the features of the convolutions to `fps` frames a second before the
    /// transformer. `None` keeps their own rate.
    #[must_use]
    pub fn resampled(self, fps: Option<f64>) -> Self {
        Hubert {
            encoder: self.encoder.resampled(fps),
        }
    }

    /// Every hidden state of `samples`, `[S]` at 16 kHz, encoded in one piece and without
    /// normalisation.
    ///
    /// # Errors
    /// `Audio` for less than one frame (400 samples).
    pub fn hidden_states(&self, samples: &[f32]) -> Result<HiddenStates> {
        self.encoder.hidden_states(samples)
    }
}

impl SpeechEncoder for Hubert {
    fn name(&self) -> &'static str {
        "hubert"
    }

    fn channels(&self) -> usize {
        self.encoder.channels()
    }

    fn encode(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<FeatureTrack> {
        self.encoder.encode(waveform, progress)
    }
}
