//! The config of a Cafe-Talk model, for inference.

use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    conditions::{ACTION_UNITS, EMOTIONS, LEARNED_UNITS},
    diffusion::{Diffusion, Spacing},
    rig::ARKIT,
    speech::SpeechInput,
    systems::Windows,
};

/// How the coarse condition enters the blocks (the paper's table 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CoarseWay {
    /// AdaLN, frame by frame.
    AdaLn,
    /// FiLM together with the timestep.
    Film,
}

/// Defaults of the reverse process.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sampling {
    /// Denoising steps.
    pub steps: usize,
    /// Which training steps these denoising steps visit.
    pub spacing: Spacing,
    /// Scale of the starting noise; 0 gives the same motion for every seed.
    pub temperature: f32,
    /// Seconds over which that noise is smoothed (standard deviation). 0: every frame has
    /// independent noise.
    #[serde(default)]
    pub noise_s: f64,
    /// Guidance of speech and coarse condition, eq. 6.
    pub alpha: f32,
    /// Guidance of events at strength 1, eq. 6.
    pub beta: f32,
}

/// `config.json` beside the weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CafeTalkConfig {
    /// "cafe_talk".
    pub system: String,
    /// "denoiser".
    pub model: String,
    /// "paper", "compact" or "debug".
    pub name: String,
    /// Names of the weights in a frame, all of them shapes of ARKit.
    pub channels: Vec<String>,
    /// Motion frames per second.
    pub fps: f64,
    /// Longest window that the model sees at once.
    pub window_frames: usize,
    /// Frames that neighbouring windows share.
    pub overlap_frames: usize,
    /// Model width `d`.
    pub width: usize,
    /// Width inside the base's attentions.
    pub inner: usize,
    /// Width inside the adapter's attentions.
    pub adapter_inner: usize,
    /// Blocks.
    pub blocks: usize,
    /// Attention heads.
    pub heads: usize,
    /// Width of the feed-forward parts.
    pub feedforward: usize,
    /// Radius of `Z_align`, frames.
    pub band: usize,
    /// How the coarse condition enters.
    pub coarse: CoarseWay,
    /// Length of a style's vector.
    pub style_width: usize,
    /// Length of a vector in the text space.
    pub text_width: usize,
    /// The encoder that feeds the model.
    pub speech: SpeechInput,
    /// The forward process.
    pub diffusion: Diffusion,
    /// Defaults of the reverse process.
    pub sampling: Sampling,
    /// Emotion categories; always [`EMOTIONS`].
    pub emotions: Vec<String>,
    /// Action units; always the first of [`ACTION_UNITS`].
    pub units: Vec<String>,
    /// Speaking styles by name.
    pub styles: Vec<String>,
    /// The style of a request that names none.
    pub default_style: String,
}

impl CafeTalkConfig {
    /// Reads and checks `config.json`.
    ///
    /// # Errors
    /// `Weights` if it is not such a file or its numbers contradict each other.
    pub fn from_json(text: &str) -> Result<Self> {
        let wrong =
            |complaint: String| Error::Weights(format!("cafe_talk config.json: {complaint}"));
        let config: CafeTalkConfig =
            serde_json::from_str(text).map_err(|error| wrong(error.to_string()))?;
        match config.complaint() {
            Some(complaint) => Err(wrong(complaint)),
            None => Ok(config),
        }
    }

    fn complaint(&self) -> Option<String> {
        let units: Vec<&str> = ACTION_UNITS[..LEARNED_UNITS]
            .iter()
            .map(|unit| unit.name)
            .collect();
        let unknown = self
            .channels
            .iter()
            .find(|name| !ARKIT.contains(&name.as_str()));
        Some(if let Some(name) = unknown {
            format!("channels: expected names of ARKit's shapes, got {name:?}")
        } else if self.emotions != EMOTIONS {
            format!("emotions: expected {EMOTIONS:?}, got {:?}", self.emotions)
        } else if self.units != units {
            format!("units: expected {units:?}, got {:?}", self.units)
        } else if self.overlap_frames >= self.window_frames {
            let (overlap, window) = (self.overlap_frames, self.window_frames);
            format!("overlap_frames: expected less than {window}, got {overlap}")
        } else if !(self.fps > 0.0 && self.fps.is_finite()) {
            format!("fps: expected a positive number, got {}", self.fps)
        } else if !self.styles.contains(&self.default_style) {
            let (known, style) = (&self.styles, &self.default_style);
            format!("default_style: expected one of {known:?}, got {style:?}")
        } else {
            return None;
        })
    }

    /// The windows in which a long clip is sampled.
    pub fn windows(&self) -> Windows {
        Windows {
            fps: self.fps,
            frames: self.window_frames,
            overlap: self.overlap_frames,
        }
    }
}
