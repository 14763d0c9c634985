//! A transformer decoder layer: self-attention, cross-attention, feed-forward.

use ndarray::{Array2, ArrayRef2};
use serde::{Deserialize, Serialize};

use super::{
    attention::{CrossAttention, KeysValues, SelfAttention},
    elementwise::{add_all, gelu_all},
    linear::Linear,
    matrix,
    norm::{LayerNorm, add_and_norm},
};
use crate::{Result, models::Weights};

/// Epsilon of PyTorch's `nn.LayerNorm`.
const EPSILON: f32 = 1e-5;

/// Where the layer normalises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NormOrder {
    /// After each residual sum, Vaswani et al. 2017.
    Post,
    /// Before each sub-layer, Xiong et al. 2020.
    Pre,
}

/// Widths of a decoder layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecoderShape {
    /// Channels `C` of the sequence.
    pub channels: usize,
    /// Attention heads; divides `channels`.
    pub heads: usize,
    /// Width of the feed-forward part.
    pub feed_forward: usize,
    /// Where the layer normalises.
    pub norm: NormOrder,
}

/// One layer with the names of PyTorch's `nn.TransformerDecoderLayer`, exact GELU and no dropout.
#[derive(Debug, Clone)]
pub struct DecoderLayer {
    order: NormOrder,
    self_attn: SelfAttention,
    multihead_attn: CrossAttention,
    linear1: Linear,
    linear2: Linear,
    norms: [LayerNorm; 3],
}

impl DecoderLayer {
    /// Reads the layer's weights.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, shape: DecoderShape) -> Result<Self> {
        let DecoderShape {
            channels, heads, ..
        } = shape;
        let norm = |name| LayerNorm::load(&weights.pp(name), channels, EPSILON);
        Ok(DecoderLayer {
            order: shape.norm,
            self_attn: SelfAttention::load(&weights.pp("self_attn"), channels, heads)?,
            multihead_attn: CrossAttention::load(&weights.pp("multihead_attn"), channels, heads)?,
            linear1: Linear::load(&weights.pp("linear1"), channels, shape.feed_forward)?,
            linear2: Linear::load(&weights.pp("linear2"), shape.feed_forward, channels)?,
            norms: [norm("norm1")?, norm("norm2")?, norm("norm3")?],
        })
    }

    /// Keys and values of the memory `[T, C]` for this layer's cross-attention.
    pub fn keys_values(&self, memory: &ArrayRef2<f32>) -> KeysValues {
        self.multihead_attn.keys_values(memory)
    }

    /// `x`: `[T, C]`. Returns `[T, C]`. For `band` see [`CrossAttention::forward`].
    pub fn forward(&self, x: Array2<f32>, memory: &KeysValues, band: Option<usize>) -> Array2<f32> {
        let [norm1, norm2, norm3] = &self.norms;
        let x = self.residual(x, norm1, |x| self.self_attn.forward(x));
        let x = self.residual(x, norm2, |x| self.multihead_attn.forward(x, memory, band));
        self.residual(x, norm3, |x| {
            self.linear2
                .forward(&self.linear1.forward_then(x, gelu_all))
        })
    }

    /// `norm(x + f(x))` or `x + f(norm(x))`.
    fn residual(
        &self,
        mut x: Array2<f32>,
        norm: &LayerNorm,
        f: impl Fn(&ArrayRef2<f32>) -> Array2<f32>,
    ) -> Array2<f32> {
        match self.order {
            NormOrder::Post => {
                let y = f(&x);
                add_and_norm(&mut x, &y, norm);
            }
            NormOrder::Pre => {
                let y = f(&norm.forward(&x));
                let values = x.as_slice_mut().expect("row-major array");
                add_all(values, matrix::values(&y));
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::{Golden, distance};
    use ndarray::Axis;

    fn check(name: &str, norm: NormOrder) {
        let golden = Golden::open(name);
        let shape = DecoderShape {
            channels: 32,
            heads: 4,
            feed_forward: 64,
            norm,
        };
        let layer = DecoderLayer::load(&golden.weights(), shape).unwrap();
        let (x, memory, y) = (golden.cube("x"), golden.cube("memory"), golden.cube("y"));
        for sample in 0..2 {
            let of = |cube: &ndarray::Array3<f32>| cube.index_axis(Axis(0), sample).to_owned();
            let memory = layer.keys_values(&of(&memory));
            let got = layer.forward(of(&x), &memory, Some(3));
            let error = distance(&got, &of(&y));
            assert!(error < 1e-5, "{error}");
        }
    }

    #[test]
    fn post_norm_layer_matches_pytorch() {
        check("decoder_layer_postnorm", NormOrder::Post);
    }

    #[test]
    fn pre_norm_layer_matches_pytorch() {
        check("decoder_layer_prenorm", NormOrder::Pre);
    }

    #[test]
    fn heads_that_do_not_divide_the_channels_are_refused() {
        let golden = Golden::open("decoder_layer_prenorm");
        let shape = DecoderShape {
            channels: 32,
            heads: 5,
            feed_forward: 64,
            norm: NormOrder::Pre,
        };
        let message = DecoderLayer::load(&golden.weights(), shape).unwrap_err();
        assert!(message.to_string().contains("got 5"), "{message}");
    }
}
