//! Two-dimensional convolution over small pictures, as one matrix product per block of rows.

use ndarray::{Array1, Array2};
use rayon::prelude::*;

use super::matrix;
use crate::{Result, models::Weights};

/// A picture with channels last: `values` is `[height, width, channels]`, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Channels.
    pub channels: usize,
    /// `[height · width · channels]`.
    pub values: Vec<f32>,
}

impl Picture {
    /// A picture of zeros.
    pub fn zeros(height: usize, width: usize, channels: usize) -> Self {
        Picture {
            height,
            width,
            channels,
            values: vec![0.0; height * width * channels],
        }
    }

    /// `max(x, 0)` everywhere.
    pub fn relu(mut self) -> Self {
        self.values.iter_mut().for_each(|v| *v = v.max(0.0));
        self
    }

    /// The sum of two pictures of the same size.
    pub fn plus(mut self, other: &Picture) -> Self {
        assert_eq!(self.values.len(), other.values.len(), "picture sizes");
        for (a, b) in self.values.iter_mut().zip(&other.values) {
            *a += b;
        }
        self
    }

    /// Every pixel becomes a square of `2 × 2` pixels of the same value.
    pub fn doubled(&self) -> Picture {
        let mut out = Picture::zeros(2 * self.height, 2 * self.width, self.channels);
        let c = self.channels;
        for (pixel, to) in out.values.chunks_exact_mut(c).enumerate() {
            let (row, column) = (pixel / (2 * self.width), pixel % (2 * self.width));
            let from = (row / 2 * self.width + column / 2) * c;
            to.copy_from_slice(&self.values[from..from + c]);
        }
        out
    }

    /// Mean over all pixels. Returns `[channels]`.
    pub fn mean(&self) -> Vec<f32> {
        let mut sums = vec![0.0; self.channels];
        for pixel in self.values.chunks_exact(self.channels) {
            for (sum, value) in sums.iter_mut().zip(pixel) {
                *sum += value;
            }
        }
        let count = (self.height * self.width) as f32;
        sums.into_iter().map(|sum| sum / count).collect()
    }
}

/// PyTorch's `nn.Conv2d` with a square kernel of odd size, zero padding of half the kernel, and
/// bias.
#[derive(Debug, Clone)]
pub struct Conv2d {
    /// `[kernel · kernel · in, out]`: the taps row by row, stacked one below the other.
    weight: Array2<f32>,
    bias: Array1<f32>,
    inputs: usize,
    kernel: usize,
    stride: usize,
}

impl Conv2d {
    /// Reads `weight` `[out, in, kernel, kernel]` and `bias` `[out]`; `shape` is
    /// `[out, in, kernel]`.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, shape: [usize; 3], stride: usize) -> Result<Self> {
        let [outputs, inputs, kernel] = shape;
        let values = weights.values("weight", &[outputs, inputs, kernel, kernel])?;
        let taps = kernel * kernel;
        let weight = Array2::from_shape_fn((taps * inputs, outputs), |(row, out)| {
            values[(out * inputs + row % inputs) * taps + row / inputs]
        });
        Ok(Conv2d {
            weight,
            bias: weights.vector("bias", outputs)?,
            inputs,
            kernel,
            stride,
        })
    }

    /// Number of output channels.
    pub fn outputs(&self) -> usize {
        self.weight.ncols()
    }

    /// `x`: `[H, W, in]`. Returns `[⌈H/stride⌉, ⌈W/stride⌉, out]`.
    ///
    /// # Panics
    /// If `x` has another number of channels.
    pub fn forward(&self, x: &Picture) -> Picture {
        assert_eq!(x.channels, self.inputs, "input channels");
        let (height, width) = (
            x.height.div_ceil(self.stride),
            x.width.div_ceil(self.stride),
        );
        let outputs = self.outputs();
        let mut out = Picture::zeros(height, width, outputs);
        // With four rows at a time, the patches of one product stay in the second-level cache.
        let rows = 4;
        out.values
            .par_chunks_mut(rows * width * outputs)
            .enumerate()
            .for_each(|(block, values)| {
                let pixels = values.len() / outputs;
                let patches = self.patches(x, block * rows * width, pixels, width);
                let columns = self.weight.nrows();
                let patches = matrix::rows_of(&patches, columns);
                matrix::product(
                    matrix::view_mut(values, outputs),
                    patches,
                    matrix::view(&self.weight),
                );
                for pixel in values.chunks_exact_mut(outputs) {
                    for (value, bias) in pixel.iter_mut().zip(&self.bias) {
                        *value += bias;
                    }
                }
            });
        out
    }

    /// The neighbourhoods of `count` output pixels from `first` on, `[count, kernel²·in]`.
    fn patches(&self, x: &Picture, first: usize, count: usize, width: usize) -> Vec<f32> {
        let c = self.inputs;
        let mut patches = vec![0.0; count * self.weight.nrows()];
        for (index, patch) in patches.chunks_exact_mut(self.weight.nrows()).enumerate() {
            let (row, column) = ((first + index) / width, (first + index) % width);
            for (tap, to) in patch.chunks_exact_mut(c).enumerate() {
                let r = row * self.stride + tap / self.kernel;
                let s = column * self.stride + tap % self.kernel;
                let half = self.kernel / 2;
                if r < half || s < half || r - half >= x.height || s - half >= x.width {
                    continue;
                }
                let from = ((r - half) * x.width + s - half) * c;
                to.copy_from_slice(&x.values[from..from + c]);
            }
        }
        patches
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn conv(inputs: usize, outputs: usize, kernel: usize, stride: usize) -> Conv2d {
        Conv2d {
            weight: Array2::from_shape_fn((kernel * kernel * inputs, outputs), |(i, j)| {
                ((i * 7 + j * 5) % 11) as f32 - 5.0
            }),
            bias: Array1::from_shape_fn(outputs, |j| j as f32),
            inputs,
            kernel,
            stride,
        }
    }

    /// The definition, pixel by pixel.
    fn slow(conv: &Conv2d, x: &Picture) -> Vec<f32> {
        let (h, w) = (
            x.height.div_ceil(conv.stride),
            x.width.div_ceil(conv.stride),
        );
        let mut out = Vec::new();
        for (row, column) in (0..h).flat_map(|r| (0..w).map(move |c| (r, c))) {
            for o in 0..conv.outputs() {
                let mut sum = conv.bias[o];
                for (dr, dc) in (0..conv.kernel).flat_map(|a| (0..conv.kernel).map(move |b| (a, b)))
                {
                    let half = (conv.kernel / 2) as isize;
                    let r = (row * conv.stride + dr) as isize - half;
                    let c = (column * conv.stride + dc) as isize - half;
                    if r < 0 || c < 0 || r >= x.height as isize || c >= x.width as isize {
                        continue;
                    }
                    for i in 0..conv.inputs {
                        let at = (r as usize * x.width + c as usize) * conv.inputs + i;
                        let tap = (dr * conv.kernel + dc) * conv.inputs + i;
                        sum += x.values[at] * conv.weight[[tap, o]];
                    }
                }
                out.push(sum);
            }
        }
        out
    }

    #[test]
    fn convolution_equals_its_definition() {
        for (kernel, stride) in [(3, 1), (3, 2), (1, 1), (5, 2)] {
            let mut x = Picture::zeros(9, 7, 3);
            let values = x.values.iter_mut().enumerate();
            values.for_each(|(i, v)| *v = ((i * 13) % 17) as f32 - 8.0);
            let conv = conv(3, 4, kernel, stride);
            assert_eq!(conv.forward(&x).values, slow(&conv, &x));
        }
    }

    #[test]
    fn doubling_repeats_every_pixel() {
        let x = Picture {
            height: 1,
            width: 2,
            channels: 2,
            values: vec![1.0, 2.0, 3.0, 4.0],
        };
        let row = [1.0, 2.0, 1.0, 2.0, 3.0, 4.0, 3.0, 4.0];
        assert_eq!(x.doubled().values, [row, row].concat());
        assert_eq!(x.mean(), [2.0, 3.0]);
    }
}
