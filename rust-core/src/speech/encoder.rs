//! What encoders of speech have in common.

use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};

use crate::{Result, audio::Waveform, job::ProgressFn, models::BuiltIn};

/// Features of a stretch of speech at a constant rate.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureTrack {
    /// `[T, C]`.
    pub features: Array2<f32>,
    /// Frames per second.
    pub rate_hz: f64,
    /// Second at which the first frame stands: the middle of the sound that it hears.
    pub first_s: f64,
}

/// Which speech features a model was trained with; a part of its `config.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpeechInput {
    /// Name of the encoder: "compact_speech", "hubert", "wav2vec2" or "whisper".
    pub encoder: String,
    /// Channels `C` of its features.
    pub channels: usize,
    /// Motion frames a second to which HuBERT and wav2vec2 bring what their convolutions hear before the transformer;
    /// without it the output of the transformer is brought there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transformer_fps: Option<f64>,
}

/// Turns sound into features.
pub trait SpeechEncoder: Send + Sync {
    /// The name that a model's [`SpeechInput`] calls it by.
    fn name(&self) -> &'static str;

    /// Number of channels `C` of the features.
    fn channels(&self) -> usize;

    /// Encodes a waveform at the encoder's own rate.
    ///
    /// # Errors
    /// [`crate::Error::Audio`] if the sound is too short to encode; `Cancelled`.
    fn encode(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<FeatureTrack>;

    /// Probability at each row of `features` `[T, C]` that the lips are together for p, b or m,
    /// `[T]`; `None` where the encoder was not trained to say so.
    fn closed_lips(&self, features: ArrayView2<'_, f32>) -> Option<Vec<f32>> {
        let _ = features;
        None
    }
}

/// Built-in weights of [`super::CompactEncoder`].
pub static COMPACT_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::COMPACT_SPEECH);

/// One frame for every started `1 / fps` seconds of a sound, at least one.
pub fn frames_of(duration_s: f64, fps: f64) -> usize {
    // A millionth of a frame is rounding, not sound.
    (duration_s * fps - 1e-6).ceil().max(1.0) as usize
}
