//! The encoder that HuBERT and wav2vec2 share: a transformer over convolutional features.
//!
//! Reads a Hugging Face folder: `config.json`, the weights under the checkpoint's own names and, if
//! present, `preprocessor_config.json`. The two networks compute the same function; they differ in
//! training and in a few names.

use std::{ops::Range, path::Path};

use ndarray::{Array1, Array2, ArrayRef2, Axis, Slice};
use rayon::prelude::*;

use super::{
    FeatureTrack, SpeechEncoder, at_motion_frames,
    conv_features::ConvFeatures,
    encoder_config::{EncoderConfig, read_preprocessor},
    frames_of,
};
use crate::{
    Error, Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
    job::{InputKind, ProgressFn, read_text, report},
    models::{Weights, checkpoint},
    nn::{
        attention::SelfAttention,
        conv::Conv1d,
        elementwise::{add_all, gelu_all},
        linear::Linear,
        matrix,
        norm::{LayerNorm, add_and_norm},
    },
};

/// Frames that are encoded at once. The cost of attention grows with their square.
const SPAN: usize = 1500;
/// Frames of context on either side of a span.
const CONTEXT: usize = 100;

/// Convolutions, projection, positions and transformer layers.
pub(super) struct TransformerEncoder {
    config: EncoderConfig,
    normalise: bool,
    /// Chooses what [`TransformerEncoder::encode`] returns.
    chosen: Chosen,
    /// Frames a second in the transformer; `None` for the rate of the convolutions.
    transformer_fps: Option<f64>,
    features: ConvFeatures,
    projection_norm: Option<LayerNorm>,
    projection: Linear,
    positions: PositionalConv,
    norm: LayerNorm,
    layers: Vec<EncoderLayer>,
}

/// A hidden state.
enum Chosen {
    /// The last state, normalised in the stable variant.
    Output,
    /// The state of this number; 0 is before the first layer.
    Layer(usize),
}

impl TransformerEncoder {
    /// Reads `config.json`, the weights (as [`super::from_folder`] does) and, if present,
    /// `preprocessor_config.json`. `layer` is as in [`super::from_folder`].
    ///
    /// # Errors
    /// Those of [`super::from_folder`].
    pub fn load_folder(folder: &Path, layer: Option<usize>) -> Result<Self> {
        let weights = checkpoint::read(folder)?;
        let config =
            EncoderConfig::from_json(&read_text(&folder.join("config.json"), InputKind::Text)?)?;
        let preprocessor = folder.join("preprocessor_config.json");
        let normalise = if preprocessor.exists() {
            read_preprocessor(&read_text(&preprocessor, InputKind::Text)?)?
        } else {
            // The default of Hugging Face's feature extractor.
            true
        };
        Self::new(config, &weights, normalise, layer)
    }

    pub fn new(
        config: EncoderConfig,
        weights: &Weights,
        normalise: bool,
        layer: Option<usize>,
    ) -> Result<Self> {
        if let Some(layer) = layer.filter(|layer| *layer > config.num_hidden_layers) {
            return Err(Error::InvalidInput(format!(
                "layer: expected 0 to {}, got {layer}",
                config.num_hidden_layers
            )));
        }
        // In checkpoints of models with a head, the encoder lies one level down.
        let weights = if weights.contains("feature_projection.projection.weight") {
            weights.clone()
        } else {
            weights.pp(&config.model_type)
        };
        let channels = *config.conv_dim.last().expect("checked");
        let (hidden, epsilon) = (config.hidden_size, config.layer_norm_eps);
        let projection = weights.pp("feature_projection");
        let encoder = weights.pp("encoder");
        Ok(TransformerEncoder {
            normalise,
            chosen: layer.map_or(Chosen::Output, Chosen::Layer),
            transformer_fps: None,
            features: ConvFeatures::load(&weights.pp("feature_extractor"), &config)?,
            projection_norm: if config.feat_proj_layer_norm {
                Some(LayerNorm::load(
                    &projection.pp("layer_norm"),
                    channels,
                    epsilon,
                )?)
            } else {
                None
            },
            projection: Linear::load(&projection.pp("projection"), channels, hidden)?,
            positions: PositionalConv::load(&encoder.pp("pos_conv_embed.conv"), &config)?,
            norm: LayerNorm::load(&encoder.pp("layer_norm"), hidden, epsilon)?,
            layers: (0..config.num_hidden_layers)
                .map(|i| EncoderLayer::load(&encoder.pp("layers").pp(i), &config))
                .collect::<Result<_>>()?,
            config,
        })
    }

    /// Resamples the features of the convolutions to `fps` frames a second, linearly between
    /// neighbours, before projection and transformer, as FaceFormer (Fan et al. 2022, section 3.2)
    /// and later systems do. The encoded features have this rate.
    ///
    /// Differs: frame `t` is sampled at `t / fps` seconds. The authors stretch all features over
    /// all frames, which by the end of a clip is off by about half a frame.
    pub fn resampled(mut self, fps: Option<f64>) -> Self {
        self.transformer_fps = fps;
        self
    }

    /// Number of frames that the convolutions give for this many samples.
    fn heard_frames(&self, samples: usize) -> usize {
        (samples - self.features.receptive_field()) / self.features.hop() + 1
    }

    /// Frames a second of the convolutions, and the time of their first frame in seconds.
    fn heard_instants(&self) -> (f64, f64) {
        let (hop, field) = (self.features.hop(), self.features.receptive_field());
        let rate_hz = f64::from(SAMPLE_RATE_HZ) / hop as f64;
        (rate_hz, 0.5 * field as f64 / f64::from(SAMPLE_RATE_HZ))
    }

    /// Features of the convolutions in a range of their frames, `[t, conv_dim.last()]`.
    fn convolved(&self, samples: &[f32], frames: Range<usize>) -> Array2<f32> {
        let (hop, field) = (self.features.hop(), self.features.receptive_field());
        // The norm of the first convolution also sees the samples after the last whole frame.
        let until = if frames.end == self.heard_frames(samples.len()) {
            samples.len()
        } else {
            (frames.end - 1) * hop + field
        };
        self.features.forward(&samples[frames.start * hop..until])
    }

    /// Like `convolved`, for frames at the rate `fps`. `is_last`: the sound ends with them.
    fn convolved_at(
        &self,
        samples: &[f32],
        frames: Range<usize>,
        (fps, is_last): (f64, bool),
    ) -> Array2<f32> {
        let heard = self.heard_frames(samples.len());
        let (rate_hz, first_s) = self.heard_instants();
        let place = |frame: usize| ((frame as f64 / fps - first_s) * rate_hz).max(0.0) as usize;
        let first = place(frames.start).min(heard - 1);
        let last = if is_last {
            heard
        } else {
            (place(frames.end - 1) + 2).min(heard)
        };
        let track = FeatureTrack {
            features: self.convolved(samples, first..last),
            rate_hz,
            first_s: first_s + first as f64 / rate_hz - frames.start as f64 / fps,
        };
        at_motion_frames(&track, frames.len(), fps)
    }

    fn check_length(&self, samples: &[f32]) -> Result<()> {
        let (field, got) = (self.features.receptive_field(), samples.len());
        if got < field {
            Err(Error::Audio(format!(
                "expected at least {field} samples at 16 kHz, got {got}"
            )))
        } else {
            Ok(())
        }
    }

    fn chosen_state(&self, x: Array2<f32>) -> Array2<f32> {
        match &self.chosen {
            Chosen::Output => self.run(x, self.layers.len(), &mut |_| ()),
            Chosen::Layer(layer) => {
                let mut last = Array2::zeros((0, 0));
                self.run(x, *layer, &mut |state| last = state.to_owned());
                last
            }
        }
    }

    /// Runs the first `layers` layers on features of the convolutions. Calls `show` with every
    /// hidden state and returns the output.
    fn run(
        &self,
        mut x: Array2<f32>,
        layers: usize,
        show: &mut dyn FnMut(&ArrayRef2<f32>),
    ) -> Array2<f32> {
        if let Some(norm) = &self.projection_norm {
            norm.forward_in_place(&mut x);
        }
        let mut x = self.projection.forward(&x);
        let positions = self.positions.forward(&x);
        add_all(
            x.as_slice_mut().expect("new array"),
            matrix::values(&positions),
        );
        if !self.config.do_stable_layer_norm {
            self.norm.forward_in_place(&mut x);
        }
        show(&x);
        for layer in &self.layers[..layers] {
            x = layer.forward(x);
            show(&x);
        }
        if self.config.do_stable_layer_norm {
            self.norm.forward_in_place(&mut x);
        }
        x
    }
}

impl SpeechEncoder for TransformerEncoder {
    fn name(&self) -> &'static str {
        if self.config.model_type == "hubert" {
            "hubert"
        } else {
            "wav2vec2"
        }
    }

    fn channels(&self) -> usize {
        self.config.hidden_size
    }

    /// The chosen hidden state at the rate of the transformer.
    ///
    /// Long sounds are encoded in spans of 1500 frames with 100 frames of context on either side
    /// (at 50 Hz 30 s and 2 s), so that the cost grows with their length and not with its square.
    /// If the first convolution normalises over time, it does so over each span with its context.
    fn encode(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<FeatureTrack> {
        let samples = if self.normalise {
            unit_variance(&waveform.samples)
        } else {
            waveform.samples.clone()
        };
        self.check_length(&samples)?;
        let heard = self.heard_frames(samples.len());
        let (rate_hz, first_s) = match self.transformer_fps {
            Some(fps) => (fps, 0.0),
            None => self.heard_instants(),
        };
        let frames = match self.transformer_fps {
            Some(fps) => frames_of(waveform.duration_s(), fps),
            None => heard,
        };
        let mut features = Array2::zeros((frames, self.channels()));
        for start in (0..frames).step_by(SPAN) {
            report(progress, "speech", start as f32 / frames as f32)?;
            let end = (start + SPAN).min(frames);
            let first = start.saturating_sub(CONTEXT);
            let last = (end + CONTEXT).min(frames);
            let x = match self.transformer_fps {
                None => self.convolved(&samples, first..last),
                Some(fps) => self.convolved_at(&samples, first..last, (fps, last == frames)),
            };
            let state = self.chosen_state(x);
            let inner = Slice::from(start - first..end - first);
            features
                .slice_axis_mut(Axis(0), Slice::from(start..end))
                .assign(&state.slice_axis(Axis(0), inner));
        }
        Ok(FeatureTrack {
            features,
            rate_hz,
            first_s,
        })
    }
}

/// A transformer encoder layer: post-norm, but pre-norm in the stable variant.
struct EncoderLayer {
    stable: bool,
    attention: SelfAttention,
    layer_norm: LayerNorm,
    intermediate_dense: Linear,
    output_dense: Linear,
    final_layer_norm: LayerNorm,
}

impl EncoderLayer {
    fn load(weights: &Weights, config: &EncoderConfig) -> Result<Self> {
        let (hidden, inner) = (config.hidden_size, config.intermediate_size);
        let (heads, epsilon) = (config.num_attention_heads, config.layer_norm_eps);
        let feed = weights.pp("feed_forward");
        Ok(EncoderLayer {
            stable: config.do_stable_layer_norm,
            attention: SelfAttention::load_separate(&weights.pp("attention"), hidden, heads)?,
            layer_norm: LayerNorm::load(&weights.pp("layer_norm"), hidden, epsilon)?,
            intermediate_dense: Linear::load(&feed.pp("intermediate_dense"), hidden, inner)?,
            output_dense: Linear::load(&feed.pp("output_dense"), inner, hidden)?,
            final_layer_norm: LayerNorm::load(&weights.pp("final_layer_norm"), hidden, epsilon)?,
        })
    }

    fn forward(&self, mut x: Array2<f32>) -> Array2<f32> {
        if self.stable {
            let attended = self.attention.forward(&self.layer_norm.forward(&x));
            x += &attended;
            let fed = self.feed_forward(&self.final_layer_norm.forward(&x));
            x += &fed;
        } else {
            let attended = self.attention.forward(&x);
            add_and_norm(&mut x, &attended, &self.layer_norm);
            let fed = self.feed_forward(&x);
            add_and_norm(&mut x, &fed, &self.final_layer_norm);
        }
        x
    }

    fn feed_forward(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        let inner = self.intermediate_dense.forward_then(x, gelu_all);
        self.output_dense.forward(&inner)
    }
}

/// Encodes relative positions by a grouped convolution over time with GELU.
struct PositionalConv {
    groups: Vec<Conv1d>,
}

impl PositionalConv {
    fn load(weights: &Weights, config: &EncoderConfig) -> Result<Self> {
        let (channels, taps) = (config.hidden_size, config.num_conv_pos_embeddings);
        let groups = config.num_conv_pos_embedding_groups;
        let width = channels / groups;
        let weight = weight_normalised(weights, [channels, width, taps])?;
        let bias = weights.vector("bias", channels)?;
        let group = |index: usize| {
            let size = width * width * taps;
            let weight = &weight[index * size..(index + 1) * size];
            let bias = bias.slice_axis(Axis(0), Slice::from(index * width..(index + 1) * width));
            Conv1d::from_parts(weight, [width, width, taps], bias.to_owned(), 1).padded(taps / 2)
        };
        let groups = (0..groups).map(group).collect();
        Ok(PositionalConv { groups })
    }

    /// `x`: `[T, C]`, zero beyond its ends. Returns `[T, C]`. If the number of taps is even, the
    /// last frame of the convolution is dropped.
    fn forward(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        let (frames, width) = (x.nrows(), self.groups[0].outputs());
        let columns = |index: usize| Slice::from(index * width..(index + 1) * width);
        let parts: Vec<Array2<f32>> = self
            .groups
            .par_iter()
            .enumerate()
            .map(|(index, conv)| {
                conv.forward_then(&x.slice_axis(Axis(1), columns(index)), gelu_all)
            })
            .collect();
        let mut out = Array2::zeros(x.dim());
        for (index, part) in parts.iter().enumerate() {
            out.slice_axis_mut(Axis(1), columns(index))
                .assign(&part.slice_axis(Axis(0), Slice::from(0..frames)));
        }
        out
    }
}

/// `g v / ‖v‖` with one norm per tap, over all other dimensions (Salimans & Kingma 2016).
///
/// Reads the names of PyTorch 2 (`parametrizations.weight.original0/1`), of PyTorch 1
/// (`weight_g/v`), or a plain `weight`.
fn weight_normalised(weights: &Weights, shape: [usize; 3]) -> Result<Vec<f32>> {
    let old = weights.contains("weight_v");
    if !old && weights.contains("weight") {
        return weights.values("weight", &shape);
    }
    let [gain, direction] = if old {
        ["weight_g", "weight_v"]
    } else {
        [
            "parametrizations.weight.original0",
            "parametrizations.weight.original1",
        ]
    };
    let taps = shape[2];
    let gain = weights.values(gain, &[1, 1, taps])?;
    let mut weight = weights.values(direction, &shape)?;
    let mut squares = vec![0.0f64; taps];
    for (index, value) in weight.iter().enumerate() {
        squares[index % taps] += f64::from(*value).powi(2);
    }
    let scale: Vec<f32> = gain
        .iter()
        .zip(&squares)
        .map(|(gain, square)| (f64::from(*gain) / square.sqrt().max(f64::MIN_POSITIVE)) as f32)
        .collect();
    for (index, value) in weight.iter_mut().enumerate() {
        *value *= scale[index % taps];
    }
    Ok(weight)
}

/// `(x − mean) / √(variance + 1e-7)`, as in Hugging Face's feature extractor.
fn unit_variance(samples: &[f32]) -> Vec<f32> {
    let samples = Array1::from_iter(samples.iter().map(|x| f64::from(*x)));
    let mean = samples.mean().unwrap_or(0.0);
    let scale = 1.0 / (samples.var(0.0) + 1e-7).sqrt();
    samples
        .iter()
        .map(|x| ((x - mean) * scale) as f32)
        .collect()
}

#[cfg(test)]
mod tests;
