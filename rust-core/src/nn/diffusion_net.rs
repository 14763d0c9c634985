//! DiffusionNet (Sharp, Attaiki, Crane, Ovsjanikov 2022): learning on surfaces by diffusion.
//!
//! Layer names are those of the authors' checkpoints. The result equals theirs up to rounding, but
//! the work is done in another order:
//!
//! - The diffused field is `Φ y` with `K` coefficients per channel. Matrices that act on channels
//!   alone (the rotation `A` of the gradients, the MLP's weight for the diffused input) are applied
//!   to the `K` coefficients instead of the `V` vertices.
//! - The gradients of the eigenvectors are precomputed ([`Surface`]), so gradients of the diffused
//!   field are dense products.
//! - `A` is complex. Three real products replace four: `k₁ = Re A (gx + gy)`,
//!   `k₂ = (Im A − Re A) gx`, `k₃ = (Re A + Im A) gy`, real part `k₁ − k₃`, imaginary `k₁ + k₂`.
//! - A block is one pass over the vertices, in pieces that stay in the cache. The pass ends by
//!   computing the spectrum from which the next block starts.
//!
//! Cost per block: `11 V C²` multiply-adds for `K = C`, at 95 % of the processor's peak rate (see
//! `nn::panels`). Several feature fields over the same mesh (frames) share the reading of the
//! operators.

use std::ops::Range;

use ndarray::{Array3, ArrayRef3, s};
use serde::{Deserialize, Serialize};

use super::{linear::Linear, matrix::rows_of, surface::Surface};
use crate::{
    Result,
    job::{SILENT, Watch},
    models::Weights,
};
use block::Block;
use fields::Fields;

mod block;
mod fields;

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiffusionNetShape {
    /// Channels of the input.
    pub inputs: usize,
    /// Channels of the output.
    pub outputs: usize,
    /// Channels `C` inside the blocks.
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

    /// The layer before the blocks, for callers that feed the blocks piece by piece.
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
        let first = |field, rows: Range<usize>, out: &mut [f32]| {
            let x = x.slice(s![field, rows, ..]);
            let values = x.as_slice().expect("rows of one field are contiguous");
            self.first_lin.forward_rows(rows_of(values, channels), out);
        };
        let watch = Watch::new(SILENT, "deform", 0.0);
        let result = self.forward_from(batch, surface, &watch, first);
        result.expect("nobody can cancel this")
    }

    /// [`DiffusionNet::forward`] with `first` in place of the first layer. `first` gets the number
    /// of a field and a range of vertices, and fills `[rows, C]`.
    ///
    /// # Errors
    /// `Cancelled`, within milliseconds.
    pub(crate) fn forward_from(
        &self,
        batch: usize,
        surface: &Surface,
        watch: &Watch<'_>,
        first: impl Fn(usize, Range<usize>, &mut [f32]) + Sync,
    ) -> Result<Array3<f32>> {
        let mut fields = Fields::new(batch, self.first_lin.outputs(), surface, watch, first);
        for (index, block) in self.blocks.iter().enumerate() {
            fields.apply(block, index + 1 < self.blocks.len());
        }
        watch.check()?;
        Ok(fields.project(&self.last_lin))
    }
}

#[cfg(test)]
mod tests;
