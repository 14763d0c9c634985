//! Layer norm whose scale, shift and gate depend on a condition; twin of `training/nn/ada_ln.py`.

use ndarray::{Array2, ArrayRef2};

use super::{
    elementwise::{silu_all, sum_of, vectorised},
    linear::Linear,
    matrix,
};
use crate::{Result, models::Weights};

/// Vectors of modulation per sub-layer: shift, scale and gate.
pub const PER_LAYER: usize = 3;
/// Epsilon of PyTorch's `layer_norm`.
const EPSILON: f32 = 1e-5;

/// Computes the modulation of all blocks from a condition (Peebles & Xie 2023; Chen et al. 2024,
/// adaLN-single).
#[derive(Debug, Clone)]
pub struct AdaLn {
    linear: Linear,
}

impl AdaLn {
    /// Reads `linear` `[3 · layers · width, condition]`.
    ///
    /// # Errors
    /// `Weights` if it is missing or has another shape.
    pub fn load(weights: &Weights, condition: usize, width: usize, layers: usize) -> Result<Self> {
        let linear = Linear::load(&weights.pp("linear"), condition, PER_LAYER * layers * width)?;
        Ok(AdaLn { linear })
    }

    /// `condition`: `[T, C]`. Returns `[T, 3 · layers · width]`.
    pub fn forward(&self, mut condition: Array2<f32>) -> Array2<f32> {
        silu_all(condition.as_slice_mut().expect("row-major array"));
        self.linear.forward(&condition)
    }
}

/// The modulation of one sub-layer of one block: the sum of columns of [`AdaLn::forward`] and rows
/// of the block's own table.
#[derive(Debug, Clone, Copy)]
pub struct Modulated<'a> {
    /// `[T, 3 · layers · width]`.
    pub ada: &'a Array2<f32>,
    /// `[3 · layers, width]`.
    pub table: &'a Array2<f32>,
    /// Index of the sub-layer.
    pub layer: usize,
}

impl Modulated<'_> {
    /// `LN(x) · (1 + scale) + shift`, `[T, C]`.
    pub fn norm(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        let mut out = x.to_owned();
        let width = x.ncols();
        let values = out.as_slice_mut().expect("row-major array");
        vectorised(|| {
            for (t, row) in values.chunks_exact_mut(width).enumerate() {
                normalise(row);
                let (shift, scale) = (self.part(t, 0), self.part(t, 1));
                let (layer_shift, layer_scale) = (self.layer_part(0), self.layer_part(1));
                for c in 0..width {
                    row[c] = row[c] * (1.0 + scale[c] + layer_scale[c]) + shift[c] + layer_shift[c];
                }
            }
        });
        out
    }

    /// `x ← x + gate · y`, `[T, C]`.
    pub fn add(&self, x: &mut Array2<f32>, y: &ArrayRef2<f32>) {
        let width = x.ncols();
        let values = x.as_slice_mut().expect("row-major array");
        let rows = values
            .chunks_exact_mut(width)
            .zip(matrix::values(y).chunks_exact(width));
        vectorised(|| {
            for (t, (x, y)) in rows.enumerate() {
                let (gate, layer_gate) = (self.part(t, 2), self.layer_part(2));
                for c in 0..width {
                    x[c] += (gate[c] + layer_gate[c]) * y[c];
                }
            }
        });
    }

    fn part(&self, t: usize, part: usize) -> &[f32] {
        let width = self.table.ncols();
        let first = (PER_LAYER * self.layer + part) * width;
        &matrix::values(self.ada)[t * self.ada.ncols() + first..][..width]
    }

    fn layer_part(&self, part: usize) -> &[f32] {
        let width = self.table.ncols();
        &matrix::values(self.table)[(PER_LAYER * self.layer + part) * width..][..width]
    }
}

fn normalise(row: &mut [f32]) {
    let scale = 1.0 / row.len() as f32;
    let mean = sum_of(row, |x| x) * scale;
    row.iter_mut().for_each(|x| *x -= mean);
    let inverse = 1.0 / (sum_of(row, |x| x * x) * scale + EPSILON).sqrt();
    row.iter_mut().for_each(|x| *x *= inverse);
}
