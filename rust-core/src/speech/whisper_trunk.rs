//! The convolutions, positions and transformer layers of Whisper's encoder (Radford et al. 2022).
//!
//! Twin of `training/speech/whisper.py`. Unlike Whisper's own programs, it does not pad sounds to
//! 30 s. So the features do not depend on silence after the sound, and a short sound costs little.
//! The whole encoder of a user's checkpoint runs here, and the built-in first layers of Whisper
//! base.

use std::{
    ops::Range,
    path::Path,
    sync::{Arc, Mutex, PoisonError, Weak},
};

use ndarray::{Array2, ArrayRef2, Axis, Slice, s};
use serde::Deserialize;

use super::{encoder::TRUNK_MODEL, whisper_mel::BANDS};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    models::{Weights, checkpoint::check_sizes},
    nn::{
        attention::SelfAttention, conv::Conv1d, elementwise::gelu_all, linear::Linear,
        norm::LayerNorm,
    },
};

/// Features a second.
pub(super) const RATE_HZ: f64 = 50.0;
/// The most features that are computed together: 12 s and 1.5 s on either side of it.
pub(super) const PLACES: usize = SPAN + 2 * CONTEXT;
/// Epsilon of all norms.
pub(super) const EPSILON: f32 = 1e-5;
/// Features that are computed together: 12 s.
const SPAN: usize = 600;
/// Features of context on either side of a span: 1.5 s.
const CONTEXT: usize = 75;
/// Frames of log-mel per feature.
const STRIDE: usize = 2;
/// The longest wavelength of the positions, over 2π.
const LONGEST_WAVE: f64 = 10_000.0;
const MODEL: &str = "whisper_trunk";

/// Sizes of the layers, under the names of `config.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub(super) struct TrunkSizes {
    /// Channels `C`.
    pub width: usize,
    /// Attention heads.
    pub heads: usize,
    /// Inner width of the feed-forward parts.
    pub feedforward: usize,
    /// Number of transformer layers.
    pub layers: usize,
}

/// `config.json` of the built-in layers.
#[derive(Deserialize)]
struct Config {
    model: String,
    bands: usize,
    #[serde(flatten)]
    sizes: TrunkSizes,
}

/// Two convolutions, position embeddings and transformer layers.
pub(super) struct WhisperTrunk {
    first: Conv1d,
    second: Conv1d,
    /// `[places, C]`
    places: Array2<f32>,
    layers: Vec<Layer>,
}

/// The built-in layers while anybody holds them: 40 MB, which all engines of a process share.
static SHARED: Mutex<Weak<WhisperTrunk>> = Mutex::new(Weak::new());

impl WhisperTrunk {
    /// The built-in layers, or those in `folder`.
    ///
    /// # Errors
    /// Those of `BuiltIn::open` and [`WhisperTrunk::load`].
    pub fn open(folder: Option<&Path>) -> Result<Arc<WhisperTrunk>> {
        let load = || {
            let files = TRUNK_MODEL.open(folder)?;
            let weights = Weights::from_bytes(&files.weights)?;
            Ok(Arc::new(WhisperTrunk::load(&weights, &files.config)?))
        };
        if folder.is_some() {
            return load();
        }
        // Nobody may hold the lock while it loads: the thread could take up another engine's work.
        let shared = || SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        let known = shared().upgrade();
        if let Some(trunk) = known {
            return Ok(trunk);
        }
        let trunk = load()?;
        *shared() = Arc::downgrade(&trunk);
        Ok(trunk)
    }

    /// From weights under our own names and the text of `config.json`. The positions are sinusoids,
    /// which are computed.
    ///
    /// # Errors
    /// `Weights` if they do not fit each other.
    pub fn load(weights: &Weights, config: &str) -> Result<Self> {
        let wrong = |what: String| Error::Weights(format!("{MODEL}: config.json: {what}"));
        let config: Config = serde_json::from_str(config).map_err(|e| wrong(e.to_string()))?;
        if (config.model.as_str(), config.bands) != (MODEL, BANDS) {
            return Err(wrong(format!(
                "expected {MODEL} and {BANDS} bands, got {} and {}",
                config.model, config.bands
            )));
        }
        config.sizes.check().map_err(wrong)?;
        let layer = |i| Layer::load(&weights.pp("layers").pp(i), config.sizes);
        Self::of(
            weights,
            ["first", "second"],
            sinusoids(config.sizes.width),
            (0..config.sizes.layers).map(layer).collect::<Result<_>>()?,
        )
    }

    /// From weights under the names of Hugging Face's `WhisperEncoder`, with `places` positions.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn of_checkpoint(weights: &Weights, sizes: TrunkSizes, places: usize) -> Result<Self> {
        let layer = |i| Layer::of_checkpoint(&weights.pp("layers").pp(i), sizes);
        Self::of(
            weights,
            ["conv1", "conv2"],
            weights.matrix("embed_positions.weight", places, sizes.width)?,
            (0..sizes.layers).map(layer).collect::<Result<_>>()?,
        )
    }

    fn of(
        weights: &Weights,
        convolutions: [&str; 2],
        places: Array2<f32>,
        layers: Vec<Layer>,
    ) -> Result<Self> {
        let width = places.ncols();
        let conv = |name: &str, inputs, stride| {
            let conv = Conv1d::load(&weights.pp(name), [width, inputs, 3], stride, true)?;
            Ok::<_, Error>(conv.padded(1))
        };
        Ok(WhisperTrunk {
            first: conv(convolutions[0], BANDS, 1)?,
            second: conv(convolutions[1], width, STRIDE)?,
            places,
            layers,
        })
    }

    /// Number of channels `C`.
    pub fn channels(&self) -> usize {
        self.places.ncols()
    }

    /// Number of layers.
    pub fn layers(&self) -> usize {
        self.layers.len()
    }

    /// The outputs of `layers`, in their order, for log-mel `[T, 80]` at 100 Hz. Runs in one piece.
    /// Each output is `[⌈T / 2⌉, C]`; 0 is before the first layer.
    ///
    /// `layers` must exist and ascend. Layers above the highest of them are not computed.
    pub fn run(&self, mel: &ArrayRef2<f32>, layers: &[usize]) -> Vec<Array2<f32>> {
        let x = self.first.forward_then(mel, gelu_all);
        let mut x = self.second.forward_then(&x, gelu_all);
        x += &self.places.slice(s![..x.nrows(), ..]);
        let (mut depth, mut outputs) = (0, Vec::with_capacity(layers.len()));
        for &layer in layers {
            for next in &self.layers[depth..layer] {
                x = next.forward(x);
            }
            depth = layer;
            outputs.push(x.clone());
        }
        outputs
    }

    /// Computes the outputs of `layers`, ascending, for a log-mel `[T, 80]` of any length, in spans
    /// of 12 s with 1.5 s of context on either side. Hands the rows of each span, and the span's
    /// own rows of each output, to `take`, in the order of time.
    ///
    /// The spans lie at fixed places of the sound. Attention sees a span and its context alone, so
    /// the outputs are close to those of [`WhisperTrunk::run`] on the whole sound and not the same.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn hear(
        &self,
        mel: &ArrayRef2<f32>,
        layers: &[usize],
        progress: ProgressFn<'_>,
        mut take: impl FnMut(Range<usize>, Vec<Array2<f32>>),
    ) -> Result<()> {
        let total = features_of(mel.nrows());
        let mut start = 0;
        while start < total {
            report(progress, "speech", start as f32 / total as f32)?;
            let end = if total - start < SPAN + CONTEXT {
                total
            } else {
                start + SPAN
            };
            let first = start.saturating_sub(CONTEXT);
            let last = (end + CONTEXT).min(total);
            let window = Slice::from(STRIDE * first..(STRIDE * last).min(mel.nrows()));
            let mut outputs = self.run(&mel.slice_axis(Axis(0), window), layers);
            for output in &mut outputs {
                output.slice_axis_inplace(Axis(0), Slice::from(start - first..end - first));
            }
            take(start..end, outputs);
            start = end;
        }
        Ok(())
    }

    /// As [`WhisperTrunk::hear`], all rows of each output together, `[⌈T / 2⌉, C]`.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn hear_whole(
        &self,
        mel: &ArrayRef2<f32>,
        layers: &[usize],
        progress: ProgressFn<'_>,
    ) -> Result<Vec<Array2<f32>>> {
        let total = features_of(mel.nrows());
        let mut outputs = vec![Array2::zeros((total, self.channels())); layers.len()];
        self.hear(mel, layers, progress, |rows, parts| {
            for (to, from) in outputs.iter_mut().zip(parts) {
                to.slice_mut(s![rows.clone(), ..]).assign(&from);
            }
        })?;
        Ok(outputs)
    }
}

/// Number of features for `frames` frames of log-mel.
pub(super) fn features_of(frames: usize) -> usize {
    frames.div_ceil(STRIDE)
}

impl TrunkSizes {
    /// Checks that no size is absurd, and that positions of this width are sinusoids.
    fn check(&self) -> std::result::Result<(), String> {
        check_sizes(&[
            ("width", self.width, 16_384),
            ("layers", self.layers, 256),
            ("heads", self.heads, 256),
            ("feedforward", self.feedforward, 65_536),
        ])?;
        if self.width >= 4 && self.width.is_multiple_of(2) {
            Ok(())
        } else {
            Err(format!(
                "width: expected an even number from 4 on, got {}",
                self.width
            ))
        }
    }
}

/// Whisper's positions, `[PLACES, C]`: sines in the first half of the channels, cosines in the
/// second, with wavelengths from 2π to 20,000π features in equal ratios.
fn sinusoids(width: usize) -> Array2<f32> {
    let waves = width / 2;
    Array2::from_shape_fn((PLACES, width), |(place, channel)| {
        let share = (channel % waves) as f64 / (waves - 1) as f64;
        let angle = place as f64 * LONGEST_WAVE.powf(-share);
        if channel < waves {
            angle.sin() as f32
        } else {
            angle.cos() as f32
        }
    })
}

/// Attention and feed-forward, each after a norm.
struct Layer {
    attention_norm: LayerNorm,
    attention: SelfAttention,
    feed_norm: LayerNorm,
    wide: Linear,
    narrow: Linear,
}

impl Layer {
    fn load(weights: &Weights, sizes: TrunkSizes) -> Result<Self> {
        let (width, inner) = (sizes.width, sizes.feedforward);
        let norm = |name| LayerNorm::load(&weights.pp(name), width, EPSILON);
        Ok(Layer {
            attention_norm: norm("attention_norm")?,
            attention: SelfAttention::load_joint(weights, width, sizes.heads)?,
            feed_norm: norm("feed_norm")?,
            wide: Linear::load(&weights.pp("wide"), width, inner)?,
            narrow: Linear::load(&weights.pp("narrow"), inner, width)?,
        })
    }

    fn of_checkpoint(weights: &Weights, sizes: TrunkSizes) -> Result<Self> {
        let (width, inner) = (sizes.width, sizes.feedforward);
        let attention = weights.pp("self_attn");
        let norm = |name| LayerNorm::load(&weights.pp(name), width, EPSILON);
        Ok(Layer {
            attention_norm: norm("self_attn_layer_norm")?,
            attention: SelfAttention::load_without_key_bias(&attention, width, sizes.heads)?,
            feed_norm: norm("final_layer_norm")?,
            wide: Linear::load(&weights.pp("fc1"), width, inner)?,
            narrow: Linear::load(&weights.pp("fc2"), inner, width)?,
        })
    }

    fn forward(&self, mut x: Array2<f32>) -> Array2<f32> {
        x += &self.attention.forward(&self.attention_norm.forward(&x));
        let inner = self
            .wide
            .forward_then(&self.feed_norm.forward(&x), gelu_all);
        x += &self.narrow.forward(&inner);
        x
    }
}
