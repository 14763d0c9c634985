//! What all speech encoders have in common.

use ndarray::Array2;
use serde::{Deserialize, Serialize};

use crate::{Result, audio::Waveform, job::ProgressFn, models::BuiltIn};

/// Features of a stretch of speech at a constant rate.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureTrack {
    /// `[T, C]`.
    pub features: Array2<f32>,
    /// Frames per second.
    pub rate_hz: f64,
    /// Time of the first frame, seconds: the middle of the sound that it covers.
    pub first_s: f64,
}

/// Which speech features a model was trained with; a part of its `config.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpeechInput {
    /// Name of the encoder: "ear", "hubert", "wav2vec2" or "whisper".
    pub encoder: String,
    /// Channels `C` of its features.
    pub channels: usize,
    /// Motion frames per second to which HuBERT and wav2vec2 resample the features of their
    /// convolutions, before the transformer. Without it, the output of the transformer is resampled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transformer_fps: Option<f64>,
}

/// Turns sound into features.
pub trait SpeechEncoder: Send + Sync {
    /// The encoder's name in a model's [`SpeechInput`].
    fn name(&self) -> &'static str;

    /// Number of channels `C` of the features.
    fn channels(&self) -> usize;

    /// Encodes a waveform at the encoder's own rate.
    ///
    /// # Errors
    /// [`crate::Error::Audio`] if the sound is too short to encode; `Cancelled`.
    fn encode(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<FeatureTrack>;
}

/// Built-in weights of the trained part of [`super::Ear`].
pub static EAR_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::EAR);

/// Built-in weights of Whisper's first layers, on which [`super::Ear`] stands.
pub static TRUNK_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_ear::WHISPER_TRUNK);

/// The number of motion frames of a sound: one for every started `1 / fps` seconds, at least one.
pub fn frames_of(duration_s: f64, fps: f64) -> usize {
    // A millionth of a frame is rounding, not sound.
    (duration_s * fps - 1e-6).ceil().max(1.0) as usize
}
