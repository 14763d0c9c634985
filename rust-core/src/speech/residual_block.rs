//! Residual blocks of dilated convolutions, of which speech encoders are built.

use ndarray::Array2;

use crate::{
    Result,
    models::Weights,
    nn::{conv::Conv1d, elementwise::gelu_all, linear::Linear, norm::LayerNorm},
};

/// Epsilon of PyTorch's norms.
const EPSILON: f32 = 1e-5;

/// Residual blocks, a strided convolution to half the rate, more such blocks, and a norm.
pub(super) struct ResidualStack {
    fine: Vec<ResidualBlock>,
    down: Conv1d,
    coarse: Vec<ResidualBlock>,
    norm: LayerNorm,
}

impl ResidualStack {
    /// From the weights `fine.0`, `fine.1` and so on, `down`, `coarse.0` and so on, and `norm`. `dilations`: of the
    /// blocks before and after the strided convolution.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, channels: usize, dilations: [&[usize]; 2]) -> Result<Self> {
        let blocks = |name: &str, dilations: &[usize]| -> Result<Vec<ResidualBlock>> {
            let weights = weights.pp(name);
            let block = |(i, d): (usize, &usize)| ResidualBlock::load(&weights.pp(i), channels, *d);
            dilations.iter().enumerate().map(block).collect()
        };
        Ok(ResidualStack {
            fine: blocks("fine", dilations[0])?,
            down: same_length(&weights.pp("down"), [channels, channels, 3], 2, 1)?,
            coarse: blocks("coarse", dilations[1])?,
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
        })
    }

    /// `[T, C]` to `[⌈T / 2⌉, C]`.
    pub fn forward(&self, mut x: Array2<f32>) -> Array2<f32> {
        for block in &self.fine {
            block.forward_in_place(&mut x);
        }
        let mut x = self.down.forward_then(&x, gelu_all);
        for block in &self.coarse {
            block.forward_in_place(&mut x);
        }
        self.norm.forward_in_place(&mut x);
        x
    }
}

/// `x + mix(GELU(conv(norm(x))))` on `[T, C]`; `conv` has 3 taps `dilation` apart.
struct ResidualBlock {
    norm: LayerNorm,
    conv: Conv1d,
    mix: Linear,
}

impl ResidualBlock {
    fn load(weights: &Weights, channels: usize, dilation: usize) -> Result<Self> {
        Ok(ResidualBlock {
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
            conv: same_length(&weights.pp("conv"), [channels, channels, 3], 1, dilation)?,
            mix: Linear::load(&weights.pp("mix"), channels, channels)?,
        })
    }

    fn forward_in_place(&self, x: &mut Array2<f32>) {
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
