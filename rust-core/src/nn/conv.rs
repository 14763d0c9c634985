//! One-dimensional convolution over time as a sum of matrix products, one per tap.

use faer::MatRef;
use ndarray::{Array1, Array2, ArrayRef2, ArrayView1, s};

use super::{elementwise::add_to_rows, matrix};
use crate::{Result, models::Weights};

/// A convolution over `[T, C]`; PyTorch's `nn.Conv1d`, channels last.
#[derive(Debug, Clone)]
pub struct Conv1d {
    /// `[taps · in, out]`: the taps stacked one below the other.
    weight: Array2<f32>,
    bias: Array1<f32>,
    inputs: usize,
    stride: usize,
    dilation: usize,
    padding: usize,
}

impl Conv1d {
    /// Reads `weight` `[out, in, taps]` and, if `bias` is true, `bias` `[out]`; otherwise the bias
    /// is 0.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, shape: [usize; 3], stride: usize, bias: bool) -> Result<Self> {
        let values = weights.first_axis_last("weight", &shape)?;
        let bias = if bias {
            weights.vector("bias", shape[0])?
        } else {
            Array1::zeros(shape[0])
        };
        Ok(Self::of_columns(&values, shape, bias, stride))
    }

    /// From a weight `[in, taps, out]` in row-major order and a bias `[out]`.
    fn of_columns(weight: &[f32], shape: [usize; 3], bias: Array1<f32>, stride: usize) -> Self {
        let [outputs, inputs, taps] = shape;
        let mut stacked = Array2::zeros((taps * inputs, outputs));
        for (index, mut row) in stacked.outer_iter_mut().enumerate() {
            let (tap, input) = (index / inputs, index % inputs);
            let from = &weight[(input * taps + tap) * outputs..][..outputs];
            row.assign(&ArrayView1::from(from));
        }
        Conv1d {
            weight: stacked,
            bias,
            inputs,
            stride,
            dilation: 1,
            padding: 0,
        }
    }

    /// From a weight `[out, in, taps]` in row-major order and a bias `[out]`.
    ///
    /// # Panics
    /// If the sizes disagree.
    pub fn from_parts(weight: &[f32], shape: [usize; 3], bias: Array1<f32>, stride: usize) -> Self {
        let [outputs, inputs, taps] = shape;
        assert_eq!(
            (weight.len(), bias.len()),
            (outputs * inputs * taps, outputs)
        );
        let columns = (0..inputs * taps)
            .flat_map(|column| weight[column..].iter().step_by(inputs * taps))
            .copied();
        let columns: Vec<f32> = columns.collect();
        Self::of_columns(&columns, shape, bias, stride)
    }

    /// This layer with taps `dilation` rows apart; `dilation` is at least 1.
    pub fn dilated(self, dilation: usize) -> Self {
        Conv1d { dilation, ..self }
    }

    /// This layer with `padding` rows of zeros before and after the input.
    pub fn padded(self, padding: usize) -> Self {
        Conv1d { padding, ..self }
    }

    /// Number of output channels.
    pub fn outputs(&self) -> usize {
        self.weight.ncols()
    }

    /// Number of taps.
    pub fn taps(&self) -> usize {
        self.weight.nrows() / self.inputs
    }

    /// Rows of the output for `rows` rows of input.
    pub fn output_rows(&self, rows: usize) -> usize {
        let (rows, reach) = (rows + 2 * self.padding, self.dilation * (self.taps() - 1));
        if rows > reach {
            (rows - reach - 1) / self.stride + 1
        } else {
            0
        }
    }

    /// `x`: `[T, in]`. Returns `[T', out]`. Passes each block of rows through `finish` while it is
    /// in the cache. `T' = (T + 2 padding − dilation (taps − 1) − 1) / stride + 1`.
    pub fn forward_then(
        &self,
        x: &ArrayRef2<f32>,
        finish: impl Fn(&mut [f32]) + Sync,
    ) -> Array2<f32> {
        assert_eq!(x.ncols(), self.inputs, "input channels");
        let padded = (self.padding > 0).then(|| with_zeros_around(x, self.padding));
        let values = matrix::values(padded.as_deref().unwrap_or(x));
        let outputs = self.outputs();
        matrix::by_row_blocks(self.output_rows(x.nrows()), outputs, |rows, out| {
            let from = rows.start * self.stride * self.inputs;
            match (self.inputs, self.dilation) {
                (1, 1) => self.one_channel(&values[from..], rows.len(), out),
                _ => self.sum_of_taps(&values[from..], rows.len(), out),
            }
            add_to_rows(out, self.bias.as_slice().expect("contiguous"));
            finish(out);
        })
    }

    /// Gathers the windows and multiplies once, because with one channel the matrix of a tap is too
    /// thin.
    fn one_channel(&self, x: &[f32], rows: usize, out: &mut [f32]) {
        let taps = self.taps();
        let windows: Vec<f32> = (0..rows)
            .flat_map(|row| &x[row * self.stride..row * self.stride + taps])
            .copied()
            .collect();
        let windows = matrix::rows_of(&windows, taps);
        let target = matrix::view_mut(out, self.outputs());
        matrix::product(target, windows, matrix::view(&self.weight));
    }

    /// `Σ_tap x[tap · dilation :: stride] W_tap`, without copying the input.
    fn sum_of_taps(&self, x: &[f32], rows: usize, out: &mut [f32]) {
        let step = self.stride * self.inputs;
        for tap in 0..self.taps() {
            let from = tap * self.dilation * self.inputs;
            let to = from + (rows - 1) * step + self.inputs;
            let x = MatRef::from_row_major_slice_with_stride(&x[from..to], rows, self.inputs, step);
            let weight = matrix::view(&self.weight).subrows(tap * self.inputs, self.inputs);
            let target = matrix::view_mut(out, self.outputs());
            match tap {
                0 => matrix::product(target, x, weight),
                _ => matrix::product_add(target, x, weight),
            }
        }
    }
}

/// `x` with `padding` rows of zeros before and after it.
fn with_zeros_around(x: &ArrayRef2<f32>, padding: usize) -> Array2<f32> {
    let (rows, columns) = x.dim();
    let mut padded = Array2::zeros((rows + 2 * padding, columns));
    padded.slice_mut(s![padding..padding + rows, ..]).assign(x);
    padded
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition as a plain sum, with zeros beyond both ends.
    fn plain(x: &Array2<f32>, weight: &[f32], shape: [usize; 3], steps: [usize; 3]) -> Array2<f32> {
        let [outputs, inputs, taps] = shape;
        let [stride, dilation, padding] = steps;
        let rows = (x.nrows() + 2 * padding - dilation * (taps - 1) - 1) / stride + 1;
        Array2::from_shape_fn((rows, outputs), |(t, o)| {
            let mut sum = 0.0;
            for i in 0..inputs {
                for k in 0..taps {
                    let row = (t * stride + k * dilation).checked_sub(padding);
                    let value = row.and_then(|row| x.get([row, i])).unwrap_or(&0.0);
                    sum += value * weight[(o * inputs + i) * taps + k];
                }
            }
            sum
        })
    }

    #[test]
    fn convolution_equals_its_definition() {
        for (inputs, taps, steps) in [
            (1, 10, [5, 1, 0]),
            (6, 3, [2, 1, 0]),
            (4, 2, [2, 1, 0]),
            (5, 4, [1, 1, 0]),
            (5, 3, [1, 8, 8]),
            (1, 3, [1, 2, 0]),
            (6, 5, [2, 1, 2]),
        ] {
            let shape = [7, inputs, taps];
            let weight: Vec<f32> = (0..7 * inputs * taps)
                .map(|i| (i as f32 * 0.37).sin())
                .collect();
            let x = Array2::from_shape_fn((203, inputs), |(t, c)| {
                ((t * inputs + c) as f32 * 0.11).cos()
            });
            let [stride, dilation, padding] = steps;
            let conv = Conv1d::from_parts(&weight, shape, Array1::zeros(7), stride)
                .dilated(dilation)
                .padded(padding);
            let got = conv.forward_then(&x, |_| ());
            let difference = &got - &plain(&x, &weight, shape, steps);
            assert!(difference.iter().all(|d| d.abs() < 1e-4));
        }
    }
}
