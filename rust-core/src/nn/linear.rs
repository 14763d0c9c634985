//! `y = x W + b`.

use faer::MatRef;
use ndarray::{Array1, Array2, ArrayRef2};

use super::{
    elementwise::{add_to_rows, vectorised},
    matrix,
};
use crate::{Result, models::Weights};

/// A linear layer; PyTorch's `nn.Linear`.
#[derive(Debug, Clone)]
pub struct Linear {
    /// `[in, out]`: transposed once at loading, because the product reads it along `out`.
    weight: Array2<f32>,
    /// `[out]`.
    bias: Array1<f32>,
}

impl Linear {
    /// Reads `weight` `[out, in]` and `bias` `[out]`.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, inputs: usize, outputs: usize) -> Result<Self> {
        let weight = weights.first_axis_last("weight", &[outputs, inputs])?;
        let weight = Array2::from_shape_vec((inputs, outputs), weight);
        Ok(Linear {
            weight: weight.expect("the shape was checked"),
            bias: weights.vector("bias", outputs)?,
        })
    }

    /// From a weight `[out, in]` and a bias `[out]`.
    ///
    /// # Panics
    /// If their `out` differs.
    pub fn from_parts(weight: &ArrayRef2<f32>, bias: Array1<f32>) -> Self {
        assert_eq!(weight.nrows(), bias.len());
        let weight = weight.t().as_standard_layout().into_owned();
        Linear { weight, bias }
    }

    /// Number of input channels.
    pub fn inputs(&self) -> usize {
        self.weight.nrows()
    }

    /// Number of output channels.
    pub fn outputs(&self) -> usize {
        self.weight.ncols()
    }

    /// The weight as `[in, out]`.
    pub fn weight(&self) -> MatRef<'_, f32> {
        matrix::view(&self.weight)
    }

    /// The bias, `[out]`.
    pub fn bias(&self) -> &[f32] {
        self.bias.as_slice().expect("a vector is contiguous")
    }

    /// A layer with only the output channels `start..start + count`.
    pub fn columns(&self, start: usize, count: usize) -> Self {
        let range = ndarray::s![.., start..start + count];
        Linear {
            weight: self.weight.slice(range).as_standard_layout().into_owned(),
            bias: self
                .bias
                .slice(ndarray::s![start..start + count])
                .to_owned(),
        }
    }

    /// `x`: `[T, in]`. Returns `[T, out]`.
    pub fn forward(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        self.forward_then(x, |_| ())
    }

    /// [`Linear::forward`], then `finish` on each block of rows while it is in the cache.
    pub fn forward_then(
        &self,
        x: &ArrayRef2<f32>,
        finish: impl Fn(&mut [f32]) + Sync,
    ) -> Array2<f32> {
        assert_eq!(x.ncols(), self.inputs(), "input channels");
        let x = matrix::view(x);
        matrix::by_row_blocks(x.nrows(), self.outputs(), |rows, out| {
            self.forward_rows(x.subrows(rows.start, rows.len()), out);
            finish(out);
        })
    }

    /// `x`: `[T, in]`; writes `[T, out]` on the calling thread.
    pub fn forward_rows(&self, x: MatRef<'_, f32>, out: &mut [f32]) {
        matrix::product(matrix::view_mut(out, self.outputs()), x, self.weight());
        add_to_rows(out, self.bias());
    }

    /// `x`: `[in]`; writes `[out]`. Sums one row, always in the same order. For sound that arrives
    /// in pieces, where a matrix product would have only one row.
    pub fn forward_row(&self, x: &[f32], out: &mut [f32]) {
        assert_eq!((x.len(), out.len()), (self.inputs(), self.outputs()));
        out.copy_from_slice(self.bias());
        let weight = self.weight.as_slice().expect("row-major array");
        vectorised(
            #[inline(always)]
            || add_product(x, weight, out),
        );
    }
}

/// `out += x W`, four rows of `W` at a time.
#[inline(always)]
fn add_product(x: &[f32], weight: &[f32], out: &mut [f32]) {
    let columns = out.len();
    let (fours, rest) = x.as_chunks::<4>();
    let (by_four, by_one) = weight.split_at(4 * fours.len() * columns);
    for (x, rows) in fours.iter().zip(by_four.chunks_exact(4 * columns)) {
        let (ab, cd) = rows.split_at(2 * columns);
        let ((a, b), (c, d)) = (ab.split_at(columns), cd.split_at(columns));
        let rows = a.iter().zip(b).zip(c).zip(d);
        for (sum, (((a, b), c), d)) in out.iter_mut().zip(rows) {
            *sum += (x[0] * a + x[1] * b) + (x[2] * c + x[3] * d);
        }
    }
    for (x, row) in rest.iter().zip(by_one.chunks_exact(columns)) {
        for (sum, w) in out.iter_mut().zip(row) {
            *sum += x * w;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::distance;

    #[test]
    fn one_row_equals_the_matrix_product() {
        for (inputs, outputs) in [(1, 1), (4, 7), (14, 20), (67, 33)] {
            let value = |i: usize, j: usize| ((i * 31 + j * 17) % 23) as f32 * 0.1 - 1.0;
            let weight = Array2::from_shape_fn((outputs, inputs), |(o, i)| value(o, i));
            let layer = Linear::from_parts(&weight, (0..outputs).map(|o| value(o, 3)).collect());
            let x = Array2::from_shape_fn((1, inputs), |(_, i)| value(5, i));
            let mut row = vec![0.0; outputs];
            layer.forward_row(matrix::values(&x), &mut row);
            assert!(distance(&row, &layer.forward(&x)) < 1e-5);
        }
    }
}
