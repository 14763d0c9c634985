//! The convolutions of the ear for emotion: a strided stem to 50 Hz, residual dilated convolutions, a
//! strided step to 25 Hz, more such convolutions, and a norm.
//!
//! Twin of `Convolutions` in `training/speech/emotion_ear.py`.

use ndarray::{Array2, ArrayRef2};

use crate::{
    Result,
    models::Weights,
    nn::{conv::Conv1d, elementwise::gelu_all, norm::LayerNorm},
    speech::residual_block::{EPSILON, ResidualBlock, residual_blocks, same_length},
};

pub(super) struct Convolutions {
    stem: Conv1d,
    fine: Vec<ResidualBlock>,
    down: Conv1d,
    coarse: Vec<ResidualBlock>,
    norm: LayerNorm,
}

impl Convolutions {
    /// `dilations`: of the blocks at 50 Hz and at 25 Hz.
    pub(super) fn load(
        [inputs, channels]: [usize; 2],
        dilations: [&[usize]; 2],
        weights: &Weights,
    ) -> Result<Self> {
        let blocks = |name, dilations| residual_blocks(&weights.pp(name), channels, dilations);
        Ok(Convolutions {
            stem: same_length(&weights.pp("stem"), [channels, inputs, 5], 2, 1)?,
            fine: blocks("fine", dilations[0])?,
            down: same_length(&weights.pp("down"), [channels, channels, 3], 2, 1)?,
            coarse: blocks("coarse", dilations[1])?,
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
        })
    }

    /// `[T, inputs]` to `[⌈⌈T/2⌉/2⌉, C]`.
    pub(super) fn forward(&self, inputs: &ArrayRef2<f32>) -> Array2<f32> {
        let mut x = self.stem.forward_then(inputs, gelu_all);
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
