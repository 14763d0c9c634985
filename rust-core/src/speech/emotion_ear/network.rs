//! The convolutions of the ear for emotion: a strided stem to 50 Hz, residual dilated convolutions, a
//! strided step to 25 Hz, more such convolutions, and a norm.
//!
//! Twin of `Convolutions` in `training/speech/emotion_ear.py`.

use ndarray::{Array2, ArrayRef2};

use crate::{
    Result,
    models::Weights,
    nn::{conv::Conv1d, elementwise::gelu_all},
    speech::residual_block::{ResidualStack, same_length},
};

pub(super) struct Convolutions {
    stem: Conv1d,
    stack: ResidualStack,
}

impl Convolutions {
    /// `dilations`: of the blocks at 50 Hz and at 25 Hz.
    pub(super) fn load(
        [inputs, channels]: [usize; 2],
        dilations: [&[usize]; 2],
        weights: &Weights,
    ) -> Result<Self> {
        Ok(Convolutions {
            stem: same_length(&weights.pp("stem"), [channels, inputs, 5], 2, 1)?,
            stack: ResidualStack::load(weights, channels, dilations)?,
        })
    }

    /// `[T, inputs]` to `[⌈⌈T/2⌉/2⌉, C]`.
    pub(super) fn forward(&self, inputs: &ArrayRef2<f32>) -> Array2<f32> {
        self.stack.forward(self.stem.forward_then(inputs, gelu_all))
    }
}
