//! Residual blocks of dilated convolutions, of which speech encoders are built.

use ndarray::Array2;

use crate::{
    Result,
    models::Weights,
    nn::{conv::Conv1d, elementwise::gelu_all, linear::Linear, norm::LayerNorm},
};

/// Epsilon of PyTorch's norms.
pub(super) const EPSILON: f32 = 1e-5;

/// A block for each of `dilations`, from the weights `0`, `1` and so on.
///
/// # Errors
/// `Weights` if one is missing or has another shape.
pub(super) fn residual_blocks(
    weights: &Weights,
    channels: usize,
    dilations: &[usize],
) -> Result<Vec<ResidualBlock>> {
    let block = |(i, d): (usize, &usize)| ResidualBlock::load(&weights.pp(i), channels, *d);
    dilations.iter().enumerate().map(block).collect()
}

/// `x + mix(GELU(conv(norm(x))))` on `[T, C]`; `conv` has 3 taps `dilation` apart.
pub(super) struct ResidualBlock {
    norm: LayerNorm,
    conv: Conv1d,
    mix: Linear,
}

impl ResidualBlock {
    pub fn load(weights: &Weights, channels: usize, dilation: usize) -> Result<Self> {
        Ok(ResidualBlock {
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
            conv: same_length(&weights.pp("conv"), [channels, channels, 3], 1, dilation)?,
            mix: Linear::load(&weights.pp("mix"), channels, channels)?,
        })
    }

    pub fn forward_in_place(&self, x: &mut Array2<f32>) {
        let y = self.conv.forward_then(&self.norm.forward(x), gelu_all);
        *x += &self.mix.forward(&y);
    }
}

/// A convolution with `shape` `[out, in, taps]` that yields `⌈T / stride⌉` rows.
pub(super) fn same_length(
    weights: &Weights,
    shape: [usize; 3],
    stride: usize,
    dilation: usize,
) -> Result<Conv1d> {
    let conv = Conv1d::load(weights, shape, stride, true)?;
    Ok(conv.dilated(dilation).padded(dilation * (shape[2] / 2)))
}
