//! Audio-to-sparse: a diffusion denoiser from speech features to 68 landmark displacements.
//!
//! FreeTalk (Nocentini et al. 2026), section 3.1; twin of `training/systems/freetalk/ats.py`. It
//! differs from the paper: a speaking-style embedding is added to the tokens; emotion enters per
//! frame, as strengths of a mixture; dimensions are standardised by a mean and a deviation stored
//! with the weights; the band mask is −∞ outside its radius, where the paper prints +1. With
//! pre-norm, a final LayerNorm follows the layers, as pre-norm requires.

use ndarray::{Array1, Array2, ArrayRef2, ArrayView2, Axis};
use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    conditions::EMOTIONS,
    diffusion::{Diffusion, Spacing},
    mesh::ibug::LANDMARKS,
    models::Weights,
    motion::EmotionOrigin,
    nn::{
        attention::KeysValues,
        elementwise::{add_all, add_to_rows},
        linear::Linear,
        matrix,
        mlp::Mlp,
        norm::LayerNorm,
        transformer::{DecoderLayer, DecoderShape, NormOrder},
    },
    speech::SpeechInput,
    systems::Windows,
};

/// Epsilon of PyTorch's `nn.LayerNorm`.
const EPSILON: f32 = 1e-5;

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
}

/// The config of the model, for inference; `config.json` beside the weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AtsConfig {
    /// "freetalk".
    pub system: String,
    /// "ats".
    pub model: String,
    /// "paper", "compact" or "debug".
    pub name: String,
    /// Number of landmarks; always 68.
    pub landmarks: usize,
    /// Motion frames per second.
    pub fps: f64,
    /// Longest window that the model sees at once.
    pub window_frames: usize,
    /// Frames that neighbouring windows share.
    pub overlap_frames: usize,
    /// Model width `d`.
    pub width: usize,
    /// Decoder layers.
    pub layers: usize,
    /// Attention heads.
    pub heads: usize,
    /// Width of the feed-forward parts.
    pub feedforward: usize,
    /// Where the layers normalise.
    pub norm: NormOrder,
    /// Radius `r` of the band mask, frames.
    pub radius: usize,
    /// The encoder that feeds the model.
    pub speech: SpeechInput,
    /// The forward process.
    pub diffusion: Diffusion,
    /// Defaults of the reverse process.
    pub sampling: Sampling,
    /// Emotion categories; always [`EMOTIONS`].
    pub emotions: Vec<String>,
    /// Whether the network shows emotion itself. If it does not, it always samples neutral motion.
    #[serde(default)]
    pub emotion: EmotionOrigin,
    /// Speaking styles by name.
    pub styles: Vec<String>,
    /// The style of a request that names none.
    pub default_style: String,
    /// Styles in which the lips meet where the speech encoder hears p, b or m. In other styles,
    /// they move as they were recorded.
    #[serde(default)]
    pub closing_styles: Vec<String>,
}

impl AtsConfig {
    /// Whether the lips meet in this style where the speech encoder hears p, b or m; `None` is the
    /// default style.
    pub fn closes_lips(&self, style: Option<&str>) -> bool {
        let style = style.unwrap_or(&self.default_style);
        self.closing_styles.iter().any(|name| name == style)
    }

    /// The windows in which a long clip is sampled.
    pub fn windows(&self) -> Windows {
        Windows {
            fps: self.fps,
            frames: self.window_frames,
            overlap: self.overlap_frames,
        }
    }

    /// Reads and checks `config.json`.
    ///
    /// # Errors
    /// `Weights` if it is not such a file or its numbers contradict each other.
    pub fn from_json(text: &str) -> Result<Self> {
        let config: AtsConfig = serde_json::from_str(text)
            .map_err(|error| Error::Weights(format!("ats config.json: {error}")))?;
        config.check()?;
        Ok(config)
    }

    fn check(&self) -> Result<()> {
        let complaint = if self.landmarks != LANDMARKS {
            format!("landmarks: expected {LANDMARKS}, got {}", self.landmarks)
        } else if self.emotions != EMOTIONS {
            format!("emotions: expected {EMOTIONS:?}, got {:?}", self.emotions)
        } else if self.overlap_frames >= self.window_frames {
            let (overlap, window) = (self.overlap_frames, self.window_frames);
            format!("overlap_frames: expected less than {window}, got {overlap}")
        } else if !(self.fps > 0.0 && self.fps.is_finite()) {
            format!("fps: expected a positive number, got {}", self.fps)
        } else if !self.styles.contains(&self.default_style) {
            let (known, style) = (&self.styles, &self.default_style);
            format!("default_style: expected one of {known:?}, got {style:?}")
        } else {
            return Ok(());
        };
        Err(Error::Weights(format!("ats config.json: {complaint}")))
    }

    /// Channels of a motion frame: three for each landmark.
    pub fn motion_channels(&self) -> usize {
        3 * self.landmarks
    }
}

/// The denoiser `f_θ(x_ℓ, ℓ, A, e, i)` with its weights.
pub struct Ats {
    config: AtsConfig,
    x_proj: Linear,
    mem_proj: Linear,
    pos_tgt: Array2<f32>,
    pos_mem: Array2<f32>,
    time_mlp: Mlp,
    affect_mlp: Mlp,
    style: Array2<f32>,
    layers: Vec<DecoderLayer>,
    norm: Option<LayerNorm>,
    head: Linear,
    mean: Array1<f32>,
    std: Array1<f32>,
}

/// The inputs that all denoising steps of a window share. They do not depend on the noisy motion.
pub struct WindowContext {
    /// Keys and values of the speech for each layer.
    memory: Vec<KeysValues>,
    /// Position, affect and style of each frame, `[T, d]`.
    tokens: Array2<f32>,
}

impl Ats {
    /// Loads the denoiser from the bytes of `model.safetensors` and the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other.
    pub fn load(weights: &[u8], config: &str) -> Result<Self> {
        Self::new(
            AtsConfig::from_json(config)?,
            &Weights::from_bytes(weights)?,
        )
    }

    pub(super) fn new(config: AtsConfig, weights: &Weights) -> Result<Self> {
        let (width, channels) = (config.width, config.motion_channels());
        let shape = DecoderShape {
            channels: width,
            heads: config.heads,
            feed_forward: config.feedforward,
            norm: config.norm,
        };
        let norm = match config.norm {
            NormOrder::Pre => Some(LayerNorm::load(&weights.pp("norm"), width, EPSILON)?),
            NormOrder::Post => None,
        };
        let emotions = config.emotions.len() - 1;
        Ok(Ats {
            x_proj: Linear::load(&weights.pp("x_proj"), channels, width)?,
            mem_proj: Linear::load(&weights.pp("mem_proj"), config.speech.channels, width)?,
            pos_tgt: weights.matrix("pos_tgt", config.window_frames, width)?,
            pos_mem: weights.matrix("pos_mem", config.window_frames, width)?,
            time_mlp: Mlp::load(&weights.pp("time_mlp"), width, width)?,
            affect_mlp: Mlp::load(&weights.pp("affect_mlp"), emotions, width)?,
            style: weights
                .pp("style")
                .matrix("weight", config.styles.len(), width)?,
            layers: (0..config.layers)
                .map(|i| DecoderLayer::load(&weights.pp("layers").pp(i), shape))
                .collect::<Result<_>>()?,
            norm,
            head: Linear::load(&weights.pp("head"), width, channels)?,
            mean: weights.vector("mean", channels)?,
            std: weights.vector("std", channels)?,
            config,
        })
    }

    /// The model's configuration.
    pub fn config(&self) -> &AtsConfig {
        &self.config
    }

    /// Prepares a window: FreeTalk eq. 6 and the keys and values of eq. 7.
    ///
    /// `speech`: `[T, C]` at the model's frame rate; `affect`: `[T, 16]`, a mixture of 15 emotions
    /// and an intensity; `T` at most `window_frames`; `style` below the number of styles.
    pub fn window(
        &self,
        speech: ArrayView2<'_, f32>,
        affect: ArrayView2<'_, f32>,
        style: usize,
    ) -> WindowContext {
        let mut memory = self.mem_proj.forward(&speech.as_standard_layout());
        add_first_rows(&mut memory, &self.pos_mem);
        let mut tokens = self.affect_mlp.forward(&strengths(affect));
        add_first_rows(&mut tokens, &self.pos_tgt);
        tokens += &self.style.row(style);
        WindowContext {
            memory: self
                .layers
                .iter()
                .map(|layer| layer.keys_values(&memory))
                .collect(),
            tokens,
        }
    }

    /// One denoising pass in standardised space, from noisy motion `[T, 204]` to clean motion.
    pub fn denoise(
        &self,
        noisy: &ArrayRef2<f32>,
        timestep: usize,
        window: &WindowContext,
    ) -> Array2<f32> {
        let mut tokens = self.x_proj.forward(noisy);
        let values = tokens.as_slice_mut().expect("new array");
        add_all(values, matrix::values(&window.tokens));
        add_to_rows(values, &self.time_mlp.of_timestep(timestep));
        for (layer, memory) in self.layers.iter().zip(&window.memory) {
            tokens = layer.forward(tokens, memory, Some(self.config.radius));
        }
        if let Some(norm) = &self.norm {
            norm.forward_in_place(&mut tokens);
        }
        self.head.forward(&tokens)
    }

    /// Converts `x` `[T, 204]` from the model's space to displacements in metres, in place.
    pub(super) fn to_metres(&self, x: &mut Array2<f32>) {
        *x *= &self.std;
        *x += &self.mean;
    }
}

fn add_first_rows(x: &mut Array2<f32>, rows: &Array2<f32>) {
    let count = x.nrows();
    let (first, _) = rows.view().split_at(Axis(0), count);
    *x += &first;
}

/// Share × intensity of every category but neutral: `[T, 16]` to `[T, 14]`.
///
/// Neutral at any intensity is thus exactly the same input as any mixture at intensity 0.
fn strengths(affect: ArrayView2<'_, f32>) -> Array2<f32> {
    let last = affect.ncols() - 1;
    Array2::from_shape_fn((affect.nrows(), last - 1), |(t, e)| {
        affect[[t, e + 1]] * affect[[t, last]]
    })
}
