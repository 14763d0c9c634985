//! Speech features: one trait, three encoders (compact, HuBERT, wav2vec2).

mod compact;
mod log_mel;
mod resample;

pub use compact::{CompactConfig, CompactEncoder, normalise};
pub use log_mel::{BANDS, HOP, log_mel};
pub use resample::at_motion_frames;

use crate::{Result, audio::Waveform};
use ndarray::Array2;

/// Features of a stretch of speech at a constant rate.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureTrack {
    /// `[T, C]`.
    pub features: Array2<f32>,
    /// Frames per second.
    pub rate_hz: f64,
}

/// Turns sound into features.
pub trait SpeechEncoder: Send + Sync {
    /// Number of channels `C` of the features.
    fn channels(&self) -> usize;

    /// Encodes a waveform at the encoder's own rate.
    ///
    /// # Errors
    /// [`crate::Error::Audio`] if the sound is too short to encode.
    fn encode(&self, waveform: &Waveform) -> Result<FeatureTrack>;
}
