//! Two linear layers with SiLU between them, as used after embeddings.

use ndarray::{Array2, ArrayRef2};

use super::{elementwise::silu_all, linear::Linear, timestep::timestep_embedding};
use crate::{Result, models::Weights};

/// linear1 → SiLU → linear2.
#[derive(Debug, Clone)]
pub struct Mlp {
    linear1: Linear,
    linear2: Linear,
}

impl Mlp {
    /// Reads `linear1` `[width, inputs]` and `linear2` `[width, width]`.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, inputs: usize, width: usize) -> Result<Self> {
        Ok(Mlp {
            linear1: Linear::load(&weights.pp("linear1"), inputs, width)?,
            linear2: Linear::load(&weights.pp("linear2"), width, width)?,
        })
    }

    /// `x`: `[T, inputs]`. Returns `[T, width]`.
    pub fn forward(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        let hidden = self.linear1.forward_then(x, silu_all);
        self.linear2.forward(&hidden)
    }

    /// Applies the layers to the sinusoids of a diffusion step. Returns `[width]`.
    pub fn of_timestep(&self, timestep: usize) -> Vec<f32> {
        let inputs = self.linear1.inputs();
        let sinusoids = timestep_embedding(timestep, inputs);
        let sinusoids = Array2::from_shape_vec((1, inputs), sinusoids).expect("one row");
        self.forward(&sinusoids).into_raw_vec_and_offset().0
    }
}
