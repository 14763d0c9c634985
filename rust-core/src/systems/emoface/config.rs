//! The config of an EmoFace model, for inference.

use serde::{Deserialize, Serialize};

use crate::{Error, Result, conditions::EMOTIONS, mesh::ibug::LANDMARKS, speech::SpeechInput};

/// How the two branches are combined into one motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fusion {
    /// `w ⊙ M^e + (1 − w) ⊙ M^c`.
    MeshAttention,
    /// `M^c + M^e`, the paper's table 3 without Mesh Attention.
    Sum,
}

/// `config.json` beside the weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EmoFaceConfig {
    /// "emoface".
    pub system: String,
    /// "emoface".
    pub model: String,
    /// "paper", "compact" or "debug".
    pub name: String,
    /// The template's name.
    pub template: String,
    /// Vertices `V` of the template.
    pub vertices: usize,
    /// Triangles of the template; 0 if the model has none.
    #[serde(default)]
    pub triangles: usize,
    /// Motion frames per second.
    pub fps: f64,
    /// Width `d` of a branch.
    pub width: usize,
    /// Attention heads.
    pub heads: usize,
    /// Frames in one period of the position encoding and of the attention bias.
    pub period: usize,
    /// The most frames that self-attention sees.
    pub look_back: usize,
    /// Channels `C` of the features that each branch gets.
    pub channels: usize,
    /// Vertices of a spiral.
    pub kernel: usize,
    /// Step along a spiral: it takes one vertex out of this many.
    pub dilation: usize,
    /// Frames `δ` that the convolution sees.
    pub delta: usize,
    /// Metres in one unit inside the network.
    pub scale_m: f32,
    /// How the two branches are combined into one motion.
    pub fusion: Fusion,
    /// The encoder that hears content.
    pub speech: SpeechInput,
    /// The encoder that hears emotion, HuBERT or wav2vec2. `None` means the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emotion: Option<SpeechInput>,
    /// Whether the emotion branch gets the mean features of the emotions that the ear recognises,
    /// instead of the features of the built-in encoder.
    #[serde(default)]
    pub emotion_ear: bool,
    /// Channels of the emotion features.
    pub emotion_channels: usize,
    /// Emotions that the emotion branch has learned, each one of [`EMOTIONS`].
    pub emotions: Vec<String>,
    /// Speaking styles by name.
    pub styles: Vec<String>,
    /// The style of a request that names none.
    pub default_style: String,
    /// The template's vertex for each landmark.
    pub landmarks: Vec<usize>,
}

impl EmoFaceConfig {
    /// Reads and checks `config.json`.
    ///
    /// # Errors
    /// `Weights` if it is not such a file or its numbers contradict each other.
    pub fn from_json(text: &str) -> Result<Self> {
        let wrong = |complaint: String| Error::Weights(format!("emoface config.json: {complaint}"));
        let config: EmoFaceConfig =
            serde_json::from_str(text).map_err(|error| wrong(error.to_string()))?;
        match config.complaint() {
            Some(complaint) => Err(wrong(complaint)),
            None => Ok(config),
        }
    }

    fn complaint(&self) -> Option<String> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let unknown = self
            .emotions
            .iter()
            .find(|name| !EMOTIONS.contains(&name.as_str()));
        let (count, vertices) = (self.landmarks.len(), self.vertices);
        let outside = self.landmarks.iter().find(|vertex| **vertex >= vertices);
        Some(if let Some(name) = unknown {
            format!("emotions: expected names of {EMOTIONS:?}, got {name:?}")
        } else if !positive(self.fps) {
            format!("fps: expected a positive number, got {}", self.fps)
        } else if !positive(self.scale_m.into()) {
            format!("scale_m: expected a positive number, got {}", self.scale_m)
        } else if count != LANDMARKS {
            format!("landmarks: expected {LANDMARKS}, got {count}")
        } else if let Some(vertex) = outside {
            format!("landmarks: expected vertices below {vertices}, got {vertex}")
        } else if self.channels < 16 || self.kernel == 0 || self.delta == 0 {
            let (channels, kernel, delta) = (self.channels, self.kernel, self.delta);
            format!(
                "expected at least 16 channels, a kernel and a delta of at least 1, got {channels}, \
                 {kernel}, {delta}"
            )
        } else if let Some(input) = self
            .emotion
            .as_ref()
            .filter(|x| x.channels != self.emotion_channels)
        {
            format!(
                "emotion: expected the {} channels of emotion_channels, got {}",
                self.emotion_channels, input.channels
            )
        } else if !self.styles.contains(&self.default_style) {
            let (known, style) = (&self.styles, &self.default_style);
            format!("default_style: expected one of {known:?}, got {style:?}")
        } else {
            return None;
        })
    }
}
