//! Layer normalisation.

use ndarray::{Array1, Array2, ArrayRef2};

use super::{
    elementwise::{add_all, sum_of, vectorised},
    matrix,
};
use crate::{Result, models::Weights};

/// Layer normalisation over channels, Ba et al. 2016; PyTorch's `nn.LayerNorm`.
#[derive(Debug, Clone)]
pub struct LayerNorm {
    weight: Array1<f32>,
    bias: Array1<f32>,
    epsilon: f32,
}

impl LayerNorm {
    /// Reads `weight` and `bias`, `[C]` each.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, channels: usize, epsilon: f32) -> Result<Self> {
        Ok(LayerNorm {
            weight: weights.vector("weight", channels)?,
            bias: weights.vector("bias", channels)?,
            epsilon,
        })
    }

    /// `x`: `[T, C]`. Returns `[T, C]`.
    pub fn forward(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        let mut out = x.to_owned();
        self.forward_in_place(&mut out);
        out
    }

    /// Normalises each row of `x`, `[T, C]`, in place.
    pub fn forward_in_place(&self, x: &mut Array2<f32>) {
        let values = x.as_slice_mut().expect("row-major array");
        self.forward_rows(values);
    }

    /// Normalises row-major rows in place.
    pub fn forward_rows(&self, values: &mut [f32]) {
        let weight = self.weight.as_slice().expect("contiguous");
        let bias = self.bias.as_slice().expect("contiguous");
        let scale = 1.0 / weight.len() as f32;
        vectorised(
            #[inline(always)]
            || {
                for row in values.chunks_exact_mut(weight.len()) {
                    let mean = sum_of(row, |x| x) * scale;
                    row.iter_mut().for_each(|x| *x -= mean);
                    let variance = sum_of(row, |x| x * x) * scale;
                    let inverse = 1.0 / (variance + self.epsilon).sqrt();
                    for ((x, w), b) in row.iter_mut().zip(weight).zip(bias) {
                        *x = *x * inverse * w + b;
                    }
                }
            },
        );
    }
}

/// `x + y`, then normalised: the end of a post-norm sub-layer.
pub fn add_and_norm(x: &mut Array2<f32>, y: &ArrayRef2<f32>, norm: &LayerNorm) {
    let (rows, columns) = x.dim();
    assert_eq!(x.dim(), y.dim());
    let (x_view, y_view) = (matrix::values(x), matrix::values(y));
    let summed = matrix::by_row_blocks(rows, columns, |range, out| {
        let range = range.start * columns..range.end * columns;
        out.copy_from_slice(&x_view[range.clone()]);
        add_all(out, &y_view[range]);
        norm.forward_rows(out);
    });
    *x = summed;
}
