//! What inference has to know of a speech model of FaceTalk.

use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    diffusion::{Diffusion, Spacing},
    speech::SpeechInput,
};

/// Defaults of the reverse process.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sampling {
    /// Denoising steps.
    pub steps: usize,
    /// Which training steps they visit.
    pub spacing: Spacing,
    /// Scale of the starting noise; 0 gives the same motion for every seed.
    pub temperature: f32,
    /// w of eq. 10: how much more the speech counts than chance.
    pub guidance: f32,
    /// r of eq. 8: how far codes go from the face at rest.
    pub vividness: f32,
}

/// `motion` in the `config.json` of a head; twin of `training/systems/facetalk/motion.py`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionConfig {
    /// Numbers `X` of z_ex.
    pub codes: usize,
    /// Motion frames per second.
    pub fps: f64,
    /// Model width `d`.
    pub width: usize,
    /// Width inside attentions.
    pub inner: usize,
    /// Blocks.
    pub blocks: usize,
    /// Attention heads.
    pub heads: usize,
    /// Width of the feed-forward parts.
    pub feedforward: usize,
    /// Radius of the alignment mask of eq. 7, frames.
    pub band: usize,
    /// Frames that self-attention sees, the row's own among them.
    pub look_back_frames: usize,
    /// Whether layers are modulated, the paper's table 2.
    pub film: bool,
    /// The encoder that feeds the model.
    pub speech: SpeechInput,
    /// The forward process, eq. 2.
    pub diffusion: Diffusion,
    /// Defaults of the reverse process.
    pub sampling: Sampling,
}

/// The part of `config.json` that is read here.
#[derive(Deserialize)]
struct WithMotion {
    motion: MotionConfig,
}

impl MotionConfig {
    /// Reads and checks `motion` of `config.json`.
    ///
    /// # Errors
    /// `Weights` if there is none or its numbers contradict each other.
    pub fn from_json(text: &str) -> Result<Self> {
        let wrong =
            |complaint: String| Error::Weights(format!("facetalk config.json: {complaint}"));
        let config = serde_json::from_str::<WithMotion>(text)
            .map_err(|error| wrong(error.to_string()))?
            .motion;
        match config.complaint() {
            Some(complaint) => Err(wrong(complaint)),
            None => Ok(config),
        }
    }

    fn complaint(&self) -> Option<String> {
        Some(if !(self.fps > 0.0 && self.fps.is_finite()) {
            format!("fps: expected a positive number, got {}", self.fps)
        } else if self.look_back_frames == 0 {
            "look_back_frames: expected at least 1, got 0".to_owned()
        } else if !self.film {
            "film: expected true, got false".to_owned()
        } else {
            return None;
        })
    }
}
