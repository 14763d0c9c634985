//! The config of a speech model of FaceTalk, for inference.

use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    diffusion::{Diffusion, Spacing},
    mesh::ibug::LANDMARKS,
    speech::SpeechInput,
};

/// The name that stands for the encoder in a model that follows landmark motion.
const LANDMARK_MEMORY: &str = "landmarks";

/// Defaults of the reverse process.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sampling {
    /// Denoising steps.
    pub steps: usize,
    /// Which training steps these denoising steps visit.
    pub spacing: Spacing,
    /// Scale of the starting noise; 0 gives the same motion for every seed.
    pub temperature: f32,
    /// w of eq. 10: how much more the speech counts than chance.
    pub guidance: f32,
    /// r of eq. 8: how far the codes move away from the face at rest.
    pub vividness: f32,
}

/// `motion` in the `config.json` of a head; twin of `training/systems/facetalk/motion.py`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionConfig {
    /// Size `X` of the expression code z_ex.
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
    /// Frames that self-attention sees, including the current one.
    pub look_back_frames: usize,
    /// Whether layers are modulated, as in the paper's table 2.
    pub film: bool,
    /// Whether the output of a linear layer on the speech features is added to the codes.
    #[serde(default)]
    pub direct: bool,
    /// The encoder that feeds the model.
    pub speech: SpeechInput,
    /// The forward process, eq. 2.
    pub diffusion: Diffusion,
    /// Defaults of the reverse process.
    pub sampling: Sampling,
}

/// The parts of `config.json` that inference needs.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct MotionConfigs {
    /// The model that follows speech.
    pub motion: MotionConfig,
    /// The model that follows landmark motion instead, `[T, 204]` in centimetres.
    #[serde(default)]
    pub landmark_motion: Option<MotionConfig>,
}

impl MotionConfigs {
    /// Reads and checks `config.json`.
    ///
    /// # Errors
    /// `Weights` if there is no `motion` or numbers contradict each other.
    pub fn from_json(text: &str) -> Result<Self> {
        let wrong =
            |complaint: String| Error::Weights(format!("facetalk config.json: {complaint}"));
        let configs: MotionConfigs =
            serde_json::from_str(text).map_err(|error| wrong(error.to_string()))?;
        if let Some(by_landmarks) = &configs.landmark_motion {
            let SpeechInput {
                encoder, channels, ..
            } = &by_landmarks.speech;
            if (encoder.as_str(), *channels) != (LANDMARK_MEMORY, 3 * LANDMARKS) {
                return Err(wrong(format!(
                    "landmark_motion: speech: expected {} channels of {LANDMARK_MEMORY}, got {channels} of {encoder}",
                    3 * LANDMARKS
                )));
            }
        }
        let each = [Some(&configs.motion), configs.landmark_motion.as_ref()];
        let complaint = each.into_iter().flatten().find_map(MotionConfig::complaint);
        match complaint {
            Some(complaint) => Err(wrong(complaint)),
            None => Ok(configs),
        }
    }
}

impl MotionConfig {
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
