//! Feature-wise linear modulation of the values that a layer adds; twin of `training/nn/film.py`.

use ndarray::{Array2, ArrayRef2};

use super::{
    elementwise::{silu_all, vectorised},
    linear::Linear,
    matrix,
};
use crate::{Result, models::Weights};

/// Computes scale and shift from a condition, Perez et al. 2018.
#[derive(Debug, Clone)]
pub struct Film {
    linear: Linear,
    places: usize,
}

/// Scale and shift at one place in the network, `[C]` each.
#[derive(Debug, Clone)]
pub struct Modulation {
    scale: Vec<f32>,
    shift: Vec<f32>,
}

impl Film {
    /// Reads `linear` `[2 · places · width, condition]`.
    ///
    /// # Errors
    /// `Weights` if it is missing or has another shape.
    pub fn load(weights: &Weights, condition: usize, width: usize, places: usize) -> Result<Self> {
        let linear = Linear::load(&weights.pp("linear"), condition, 2 * places * width)?;
        Ok(Film { linear, places })
    }

    /// `condition`: `[C]`. Returns scale and shift of each place.
    pub fn forward(&self, condition: &[f32]) -> Vec<Modulation> {
        let mut condition = condition.to_vec();
        silu_all(&mut condition);
        let mut out = vec![0.0; self.linear.outputs()];
        self.linear.forward_row(&condition, &mut out);
        let width = out.len() / (2 * self.places);
        out.chunks_exact(2 * width)
            .map(|place| Modulation {
                scale: place[..width].to_vec(),
                shift: place[width..].to_vec(),
            })
            .collect()
    }
}

impl Modulation {
    /// `x ← x + (1 + scale) · y + shift`, all `[T, C]`.
    pub fn add(&self, x: &mut Array2<f32>, y: &ArrayRef2<f32>) {
        let width = self.scale.len();
        let values = x.as_slice_mut().expect("row-major array");
        let rows = values.chunks_exact_mut(width);
        vectorised(|| {
            for (x, y) in rows.zip(matrix::values(y).chunks_exact(width)) {
                for (((x, y), scale), shift) in
                    x.iter_mut().zip(y).zip(&self.scale).zip(&self.shift)
                {
                    *x += (1.0 + scale) * y + shift;
                }
            }
        });
    }
}
