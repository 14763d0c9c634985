//! The convolutional front end that HuBERT and wav2vec2 share: samples to frames at 50 Hz.

use ndarray::{Array2, ArrayRef2};
use rayon::prelude::*;

use super::encoder_config::{EncoderConfig, FeatureNorm};
use crate::{
    Result,
    models::Weights,
    nn::{
        conv::Conv1d,
        elementwise::{gelu, gelu_all},
        matrix,
        norm::LayerNorm,
    },
};

/// Epsilon of PyTorch's norms.
const EPSILON: f32 = 1e-5;

/// Strided convolutions with exact GELU, Baevski et al. 2020, section 2.
pub(super) struct ConvFeatures {
    layers: Vec<ConvLayer>,
    hop: usize,
    receptive_field: usize,
}

struct ConvLayer {
    conv: Conv1d,
    norm: Norm,
}

enum Norm {
    None,
    /// Over time for each channel.
    Channel(ChannelNorm),
    /// Over channels for each frame.
    Frame(LayerNorm),
}

impl ConvFeatures {
    /// Reads `conv_layers.{i}.conv` and `.layer_norm`.
    pub fn load(weights: &Weights, config: &EncoderConfig) -> Result<Self> {
        let layers = (0..config.conv_dim.len())
            .map(|i| ConvLayer::load(&weights.pp("conv_layers").pp(i), config, i))
            .collect::<Result<_>>()?;
        let hop = config.conv_stride.iter().product();
        let pairs = config.conv_kernel.iter().zip(&config.conv_stride);
        let receptive_field = pairs.rev().fold(1, |field, (k, s)| (field - 1) * s + k);
        Ok(ConvFeatures {
            layers,
            hop,
            receptive_field,
        })
    }

    /// Samples from one frame to the next.
    pub fn hop(&self) -> usize {
        self.hop
    }

    /// Number of samples that one frame depends on.
    pub fn receptive_field(&self) -> usize {
        self.receptive_field
    }

    /// `samples`: `[S]` at 16 kHz. Returns `[T, conv_dim.last()]`.
    pub fn forward(&self, samples: &[f32]) -> Array2<f32> {
        let samples = Array2::from_shape_vec((samples.len(), 1), samples.to_vec());
        let samples = samples.expect("one channel");
        self.layers
            .iter()
            .fold(samples, |x, layer| layer.forward(&x))
    }
}

impl ConvLayer {
    fn load(weights: &Weights, config: &EncoderConfig, index: usize) -> Result<Self> {
        let outputs = config.conv_dim[index];
        let inputs = match index {
            0 => 1,
            _ => config.conv_dim[index - 1],
        };
        let shape = [outputs, inputs, config.conv_kernel[index]];
        let stride = config.conv_stride[index];
        let norm = weights.pp("layer_norm");
        Ok(ConvLayer {
            conv: Conv1d::load(&weights.pp("conv"), shape, stride, config.conv_bias)?,
            norm: match (config.feat_extract_norm, index) {
                (FeatureNorm::Layer, _) => Norm::Frame(LayerNorm::load(&norm, outputs, EPSILON)?),
                (FeatureNorm::Group, 0) => Norm::Channel(ChannelNorm::load(&norm, outputs)?),
                (FeatureNorm::Group, _) => Norm::None,
            },
        })
    }

    fn forward(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        match &self.norm {
            Norm::None => self.conv.forward_then(x, gelu_all),
            Norm::Frame(norm) => self.conv.forward_then(x, |rows| {
                norm.forward_rows(rows);
                gelu_all(rows);
            }),
            Norm::Channel(norm) => {
                let mut x = self.conv.forward_then(x, |_| ());
                norm.forward_gelu(&mut x);
                x
            }
        }
    }
}

/// Normalisation of each channel over time: PyTorch's `nn.GroupNorm` with a group per channel.
struct ChannelNorm {
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl ChannelNorm {
    fn load(weights: &Weights, channels: usize) -> Result<Self> {
        Ok(ChannelNorm {
            weight: weights.values("weight", &[channels])?,
            bias: weights.values("bias", &[channels])?,
        })
    }

    /// Normalises `x`, `[T, C]`, over `T`, then applies GELU, in place.
    fn forward_gelu(&self, x: &mut Array2<f32>) {
        let channels = x.ncols();
        let mean = channel_means(x, &vec![0.0; channels], |x| x);
        let variance = channel_means(x, &mean, |x| x * x);
        let scale: Vec<f32> = variance
            .iter()
            .zip(&self.weight)
            .map(|(variance, weight)| weight / (variance + EPSILON).sqrt())
            .collect();
        let rows = matrix::rows_per_block(x.nrows());
        let values = x.as_slice_mut().expect("row-major array");
        values.par_chunks_mut(rows * channels).for_each(|block| {
            crate::nn::elementwise::vectorised(|| {
                for row in block.chunks_exact_mut(channels) {
                    for c in 0..channels {
                        row[c] = gelu((row[c] - mean[c]) * scale[c] + self.bias[c]);
                    }
                }
            });
        });
    }
}

/// Mean over time of `f(x − centre)` for each channel, summed in double precision over blocks.
fn channel_means(x: &Array2<f32>, centre: &[f32], f: impl Fn(f32) -> f32 + Sync) -> Vec<f32> {
    let channels = x.ncols();
    let rows = matrix::rows_per_block(x.nrows());
    let sums: Vec<Vec<f32>> = matrix::values(x)
        .par_chunks(rows * channels)
        .map(|block| {
            let mut sums = vec![0.0; channels];
            crate::nn::elementwise::vectorised(|| {
                for row in block.chunks_exact(channels) {
                    for c in 0..channels {
                        sums[c] += f(row[c] - centre[c]);
                    }
                }
            });
            sums
        })
        .collect();
    let total = |c: usize| sums.iter().map(|block| f64::from(block[c])).sum::<f64>();
    let count = x.nrows().max(1) as f64;
    (0..channels).map(|c| (total(c) / count) as f32).collect()
}
