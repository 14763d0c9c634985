//! DiffusionNet (Sharp, Attaiki, Crane, Ovsjanikov 2022): learning on surfaces by diffusion.
//!
//! Layer names are those of the authors' checkpoints. The result is theirs up to rounding; the order
//! of work is not:
//!
//! - The diffused field is `Φ y` with `K` coefficients per channel. What acts on channels alone
//!   (the rotation `A` of the gradients, the MLP's weight for the diffused input) is applied to the
//!   `K` coefficients instead of the `V` vertices.
//! - The gradients of the eigenvectors are known ([`Surface`]), so that gradients of the diffused
//!   field are dense products.
//! - `A` is complex: three real products instead of four, `k₁ = Re A (gx + gy)`,
//!   `k₂ = (Im A − Re A) gx`, `k₃ = (Re A + Im A) gy`, real part `k₁ − k₃`, imaginary `k₁ + k₂`.
//! - A block is one pass over the vertices in pieces that stay in the cache, and the pass ends with
//!   the spectrum that the next block starts from.
//!
//! Cost per block: `11 V C²` multiply-adds for `K = C`, at 95 % of what the processor can multiply and add
//! ([`Panels`]). Several feature fields over the same mesh (frames) share the reading of the operators.

use std::ops::Range;

use ndarray::{Array1, Array2, Array3, ArrayRef3, s};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    Weights,
    elementwise::{exp, vectorised},
    linear::Linear,
    matrix::{self, rows_of, view},
    panels::{Finish, Panels, Start},
    surface::Surface,
};
use crate::Result;
use fields::Fields;

mod fields;

/// Least diffusion time, as in the authors' code.
const LEAST_TIME: f32 = 1e-8;

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiffusionNetShape {
    /// Channels of the input.
    pub inputs: usize,
    /// Channels of the output.
    pub outputs: usize,
    /// Channels `C` inside.
    pub width: usize,
    /// Number of blocks.
    pub blocks: usize,
}

/// Blocks between two linear layers; no activation after the last.
#[derive(Debug, Clone)]
pub struct DiffusionNet {
    first_lin: Linear,
    blocks: Vec<Block>,
    last_lin: Linear,
}

/// `x + mlp(x, diffused x, gradient features)`.
#[derive(Debug, Clone)]
struct Block {
    /// `[C]`, in the surface's unit of area.
    time: Array1<f32>,
    rotation: Rotation,
    /// The MLP's first weight for the diffused input, `[C, C]`.
    from_diffused: Panels,
    /// The same for the input and for the gradient features.
    from_x: Panels,
    from_features: Panels,
    middle: Panels,
    last: Panels,
    /// Of the MLP's three layers.
    biases: [Vec<f32>; 3],
}

/// The matrix `A` of the gradients, three times `[C, C]`.
#[derive(Debug, Clone)]
struct Rotation {
    /// `Re Aᵀ`.
    real: Panels,
    /// `(Im A − Re A)ᵀ`.
    difference: Panels,
    /// `(Re A + Im A)ᵀ`.
    sum: Panels,
}

impl DiffusionNet {
    /// Reads `first_lin`, `block_{i}` and `last_lin`.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, shape: DiffusionNetShape) -> Result<Self> {
        let DiffusionNetShape { width, .. } = shape;
        Ok(DiffusionNet {
            first_lin: Linear::load(&weights.pp("first_lin"), shape.inputs, width)?,
            blocks: (0..shape.blocks)
                .map(|i| Block::load(&weights.pp(format!("block_{i}")), width))
                .collect::<Result<_>>()?,
            last_lin: Linear::load(&weights.pp("last_lin"), width, shape.outputs)?,
        })
    }

    /// The layer in front of the blocks, for callers that feed them piece by piece.
    pub fn first_lin(&self) -> &Linear {
        &self.first_lin
    }

    /// `x`: `[B, V, inputs]`, fields over one surface. Returns `[B, V, outputs]`.
    ///
    /// # Panics
    /// If `x` has another number of vertices or channels.
    pub fn forward(&self, x: &ArrayRef3<f32>, surface: &Surface) -> Array3<f32> {
        let (batch, vertices, channels) = x.dim();
        assert_eq!(vertices, surface.vertices(), "vertices");
        assert_eq!(channels, self.first_lin.inputs(), "input channels");
        let x = x.as_standard_layout();
        self.forward_from(batch, surface, |field, rows, out| {
            let x = x.slice(s![field, rows, ..]);
            let values = x.as_slice().expect("rows of one field are contiguous");
            self.first_lin.forward_rows(rows_of(values, channels), out);
        })
    }

    /// [`DiffusionNet::forward`] from what `first` writes instead of the first layer: it gets the
    /// number of a field and a range of vertices and fills `[rows, C]`.
    pub fn forward_from(
        &self,
        batch: usize,
        surface: &Surface,
        first: impl Fn(usize, Range<usize>, &mut [f32]) + Sync,
    ) -> Array3<f32> {
        let mut fields = Fields::new(batch, self.first_lin.outputs(), surface, first);
        for (index, block) in self.blocks.iter().enumerate() {
            fields.apply(block, index + 1 < self.blocks.len());
        }
        fields.project(&self.last_lin)
    }
}

impl Block {
    fn load(weights: &Weights, width: usize) -> Result<Self> {
        let layer = |i: usize, inputs| {
            let name = format!("mlp.miniMLP_mlp_layer_{i:03}");
            Linear::load(&weights.pp(name), inputs, width)
        };
        let [first, middle, last] = [layer(0, 3 * width)?, layer(1, width)?, layer(2, width)?];
        let part = |index| Panels::new(first.weight().subrows(index * width, width));
        Ok(Block {
            time: weights.pp("diffusion").vector("diffusion_time", width)?,
            rotation: Rotation::load(&weights.pp("gradient_features"), width)?,
            from_x: part(0),
            from_diffused: part(1),
            from_features: part(2),
            middle: Panels::new(middle.weight()),
            last: Panels::new(last.weight()),
            biases: [&first, &middle, &last].map(|layer| layer.bias().to_vec()),
        })
    }

    /// What the pass over the vertices needs of one field's spectrum `[K, C]`.
    fn coefficients(&self, mut spectrum: Array2<f32>, evals: &Array1<f32>) -> Coefficients {
        vectorised(
            #[inline(always)]
            || {
                for (mut row, eval) in spectrum.rows_mut().into_iter().zip(evals) {
                    let row = row.as_slice_mut().expect("row-major array");
                    for (value, time) in row.iter_mut().zip(&self.time) {
                        *value *= exp(-eval * time.max(LEAST_TIME));
                    }
                }
            },
        );
        let factors = [
            &self.from_diffused,
            &self.rotation.real,
            &self.rotation.difference,
            &self.rotation.sum,
        ];
        let mut products: Vec<Panels> = factors
            .into_par_iter()
            .map(|factor| Panels::new(view(&times(&spectrum, factor))))
            .collect();
        let mut next = || products.pop().expect("four products");
        let (sum, difference, turned, mixed) = (next(), next(), next(), next());
        Coefficients {
            diffused: Panels::new(view(&spectrum)),
            mixed,
            turned,
            difference,
            sum,
        }
    }
}

impl Rotation {
    /// Reads `A_re` and `A_im`.
    fn load(weights: &Weights, width: usize) -> Result<Self> {
        let a = |name: &str| weights.pp(name).matrix("weight", width, width);
        let (re, im) = (a("A_re")?, a("A_im")?);
        let packed = |a: &Array2<f32>| Panels::new(view(a).transpose());
        Ok(Rotation {
            difference: packed(&(&im - &re)),
            sum: packed(&(&re + &im)),
            real: packed(&re),
        })
    }
}

fn times(lhs: &Array2<f32>, rhs: &Panels) -> Array2<f32> {
    let mut out = Array2::zeros((lhs.nrows(), rhs.columns()));
    let target = out.as_slice_mut().expect("new array");
    rhs.multiply(matrix::values(lhs), Start::Zero, Finish::Plain, target);
    out
}

/// One diffused field `y` in the eigenbasis, multiplied by everything that acts on channels alone, `[K, C]` each.
struct Coefficients {
    /// `y`.
    diffused: Panels,
    /// `y W_d`.
    mixed: Panels,
    /// `y Re Aᵀ`.
    turned: Panels,
    /// `y (Im A − Re A)ᵀ`.
    difference: Panels,
    /// `y (Re A + Im A)ᵀ`.
    sum: Panels,
}

#[cfg(test)]
mod tests;
