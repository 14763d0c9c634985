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
//! Cost per block: `22 V C²` multiply-adds for `K = C`. Several feature fields over the same mesh
//! (frames) share the reading of the operators.

use std::ops::Range;

use faer::MatRef;
use ndarray::{Array1, Array2, Array3, ArrayRef2, ArrayRef3, s};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    Weights,
    elementwise::{add_to_rows, relu_all, tanh, vectorised},
    linear::Linear,
    matrix::{self, rows_of, view, view_mut},
    surface::Surface,
};
use crate::Result;

/// Rows that are worked on at once: their operators and intermediate fields fit a 1 MB cache.
const TILE: usize = 256;
/// At most this many pieces of parallel work, whatever the number of threads, so that sums over
/// vertices are always taken in the same order.
const PIECES: usize = 32;
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
    a_re: Linear,
    /// `Im A − Re A`.
    a_difference: Linear,
    /// `Re A + Im A`.
    a_sum: Linear,
    mlp: [Linear; 3],
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
        let features = weights.pp("gradient_features");
        let a = |name: &str| features.pp(name).matrix("weight", width, width);
        let (re, im) = (a("A_re")?, a("A_im")?);
        let rotation = |a: &ArrayRef2<f32>| Linear::from_parts(a, Array1::zeros(width));
        let layer = |i: usize, inputs| {
            let name = format!("mlp.miniMLP_mlp_layer_{i:03}");
            Linear::load(&weights.pp(name), inputs, width)
        };
        Ok(Block {
            time: weights.pp("diffusion").vector("diffusion_time", width)?,
            a_difference: rotation(&(&im - &re)),
            a_sum: rotation(&(&re + &im)),
            a_re: rotation(&re),
            mlp: [layer(0, 3 * width)?, layer(1, width)?, layer(2, width)?],
        })
    }

    /// What the pass over the vertices needs of one field's spectrum `[K, C]`.
    fn coefficients(&self, mut spectrum: Array2<f32>, evals: &Array1<f32>) -> Coefficients {
        for (mut row, eval) in spectrum.rows_mut().into_iter().zip(evals) {
            for (value, time) in row.iter_mut().zip(&self.time) {
                *value *= (-eval * time.max(LEAST_TIME)).exp();
            }
        }
        let (pairs, width) = spectrum.dim();
        let beside = |rotated: &Linear| {
            let mut both = Array2::zeros((pairs, 2 * width));
            both.slice_mut(s![.., ..width]).assign(&spectrum);
            let rotated = times(&spectrum, rotated.weight());
            both.slice_mut(s![.., width..]).assign(&rotated);
            both
        };
        let mixing = self.mlp[0].weight().subrows(width, width);
        Coefficients {
            mixed: times(&spectrum, mixing),
            turned: times(&spectrum, self.a_re.weight()),
            along_x: beside(&self.a_difference),
            along_y: beside(&self.a_sum),
        }
    }
}

fn times(lhs: &ArrayRef2<f32>, rhs: MatRef<'_, f32>) -> Array2<f32> {
    let mut out = Array2::zeros((lhs.nrows(), rhs.ncols()));
    let target = out.as_slice_mut().expect("new array");
    matrix::product(view_mut(target, rhs.ncols()), view(lhs), rhs);
    out
}

/// One diffused field in the eigenbasis, multiplied by everything that acts on channels alone.
struct Coefficients {
    /// `y W_d`, `[K, C]`.
    mixed: Array2<f32>,
    /// `y Re Aᵀ`, `[K, C]`.
    turned: Array2<f32>,
    /// `y` and `y (Im A − Re A)ᵀ`, `[K, 2 C]`.
    along_x: Array2<f32>,
    /// `y` and `y (Re A + Im A)ᵀ`, `[K, 2 C]`.
    along_y: Array2<f32>,
}

/// All fields of a batch, cut into pieces by vertices.
struct Fields<'a> {
    surface: &'a Surface,
    width: usize,
    pieces: Vec<Piece>,
}

/// Some consecutive vertices of every field.
struct Piece {
    rows: Range<usize>,
    /// For each field `[rows, C]`.
    fields: Vec<Vec<f32>>,
    /// For each field this piece's share of `Φᵀ M x`, `[K, C]`.
    spectra: Vec<Array2<f32>>,
}

impl<'a> Fields<'a> {
    fn new(
        batch: usize,
        width: usize,
        surface: &'a Surface,
        first: impl Fn(usize, Range<usize>, &mut [f32]) + Sync,
    ) -> Self {
        let vertices = surface.vertices();
        let rows_each = vertices.div_ceil(PIECES * TILE).max(1) * TILE;
        let pieces = (0..vertices.div_ceil(rows_each))
            .into_par_iter()
            .map_init(
                || Workspace::new(surface, width),
                |work, index| {
                    let rows = index * rows_each..((index + 1) * rows_each).min(vertices);
                    let mut piece = Piece::new(rows.clone(), batch, width, surface.eigenpairs());
                    for tile in tiles(rows) {
                        for field in 0..batch {
                            let x = piece.tile(field, &tile, width);
                            first(field, tile.clone(), x);
                            work.add_spectrum(surface, &tile, &mut piece, field);
                        }
                    }
                    piece
                },
            )
            .collect();
        Fields {
            surface,
            width,
            pieces,
        }
    }

    /// One block on every field; `spectra` says whether another block follows.
    fn apply(&mut self, block: &Block, spectra: bool) {
        let (surface, width) = (self.surface, self.width);
        let coefficients: Vec<Coefficients> = (0..self.batch())
            .into_par_iter()
            .map(|field| block.coefficients(self.spectrum(field), &surface.evals))
            .collect();
        self.pieces.par_iter_mut().for_each_init(
            || Workspace::new(surface, width),
            |work, piece| {
                piece.spectra.iter_mut().for_each(|s| s.fill(0.0));
                for tile in tiles(piece.rows.clone()) {
                    work.add_gradients(surface, &tile);
                    for (field, coefficients) in coefficients.iter().enumerate() {
                        let x = piece.tile(field, &tile, width);
                        work.block(block, coefficients, surface, &tile, x);
                        if spectra {
                            work.add_spectrum(surface, &tile, piece, field);
                        }
                    }
                }
            },
        );
    }

    fn batch(&self) -> usize {
        self.pieces.first().map_or(0, |piece| piece.fields.len())
    }

    /// `Φᵀ M x` of one field, `[K, C]`, summed over the pieces in their order.
    fn spectrum(&self, field: usize) -> Array2<f32> {
        let mut sum = Array2::zeros((self.surface.eigenpairs(), self.width));
        for piece in &self.pieces {
            sum += &piece.spectra[field];
        }
        sum
    }

    /// A linear layer on every field, `[B, V, out]`.
    fn project(&self, last: &Linear) -> Array3<f32> {
        let (batch, vertices) = (self.batch(), self.surface.vertices());
        let mut out = Array3::zeros((batch, vertices, last.outputs()));
        for (field, mut out) in out.outer_iter_mut().enumerate() {
            let mut rest = out.as_slice_mut().expect("new array");
            let mut targets = Vec::with_capacity(self.pieces.len());
            for piece in &self.pieces {
                let (target, after) = rest.split_at_mut(piece.rows.len() * last.outputs());
                targets.push((piece, target));
                rest = after;
            }
            targets.into_par_iter().for_each(|(piece, target)| {
                let x = &piece.fields[field];
                last.forward_rows(rows_of(x, self.width), target);
            });
        }
        out
    }
}

fn tiles(rows: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = rows.end;
    rows.step_by(TILE)
        .map(move |start| start..(start + TILE).min(end))
}

impl Piece {
    fn new(rows: Range<usize>, batch: usize, width: usize, pairs: usize) -> Self {
        let size = rows.len() * width;
        Piece {
            rows,
            fields: vec![vec![0.0; size]; batch],
            spectra: vec![Array2::zeros((pairs, width)); batch],
        }
    }

    fn tile(&mut self, field: usize, tile: &Range<usize>, width: usize) -> &mut [f32] {
        let start = (tile.start - self.rows.start) * width;
        &mut self.fields[field][start..start + tile.len() * width]
    }
}

/// Intermediate fields of one tile.
struct Workspace {
    width: usize,
    /// `(G_x + G_y) Φ`, `[rows, K]`.
    gradient: Vec<f32>,
    /// `gx` and `k₂`, `[rows, 2 C]`.
    along_x: Vec<f32>,
    /// `gy` and `k₃`, `[rows, 2 C]`.
    along_y: Vec<f32>,
    /// `k₁`, then the gradient features, then the second hidden layer, `[rows, C]`.
    features: Vec<f32>,
    /// First hidden layer, and `M x`, `[rows, C]`.
    hidden: Vec<f32>,
}

impl Workspace {
    fn new(surface: &Surface, width: usize) -> Self {
        let rows = TILE.min(surface.vertices());
        Workspace {
            width,
            gradient: vec![0.0; rows * surface.eigenpairs()],
            along_x: vec![0.0; rows * 2 * width],
            along_y: vec![0.0; rows * 2 * width],
            features: vec![0.0; rows * width],
            hidden: vec![0.0; rows * width],
        }
    }

    /// `(G_x + G_y) Φ` of a tile, once for all fields.
    fn add_gradients(&mut self, surface: &Surface, tile: &Range<usize>) {
        let pairs = surface.eigenpairs();
        let range = tile.start * pairs..tile.end * pairs;
        let x = &matrix::values(&surface.grad_x)[range.clone()];
        let y = &matrix::values(&surface.grad_y)[range];
        let sum = &mut self.gradient[..x.len()];
        vectorised(|| {
            for ((sum, x), y) in sum.iter_mut().zip(x).zip(y) {
                *sum = x + y;
            }
        });
    }

    /// One block on a tile of one field `x`, `[rows, C]`, in place.
    fn block(
        &mut self,
        block: &Block,
        coefficients: &Coefficients,
        surface: &Surface,
        tile: &Range<usize>,
        x: &mut [f32],
    ) {
        let (rows, width) = (tile.len(), self.width);
        let of = |basis| view(basis).subrows(tile.start, rows);
        self.gradient_features(coefficients, of(&surface.grad_x), of(&surface.grad_y));
        let features = &mut self.features[..rows * width];
        let hidden = &mut self.hidden[..rows * width];

        let [mix, middle, last] = &block.mlp;
        let (from_x, from_features) = (
            mix.weight().subrows(0, width),
            mix.weight().subrows(2 * width, width),
        );
        matrix::product(view_mut(hidden, width), rows_of(x, width), from_x);
        let diffused = view(&coefficients.mixed);
        matrix::product_add(view_mut(hidden, width), of(&surface.evecs), diffused);
        matrix::product_add(
            view_mut(hidden, width),
            rows_of(features, width),
            from_features,
        );
        add_to_rows(hidden, mix.bias());
        relu_all(hidden);
        middle.forward_rows(rows_of(hidden, width), features);
        relu_all(features);
        matrix::product_add(view_mut(x, width), rows_of(features, width), last.weight());
        add_to_rows(x, last.bias());
    }

    /// `tanh(gx Re(A g) + gy Im(A g))`, eq. 8, into `features`.
    fn gradient_features(
        &mut self,
        coefficients: &Coefficients,
        grad_x: MatRef<'_, f32>,
        grad_y: MatRef<'_, f32>,
    ) {
        let (rows, pairs, width) = (grad_x.nrows(), grad_x.ncols(), self.width);
        let along_x = &mut self.along_x[..rows * 2 * width];
        let along_y = &mut self.along_y[..rows * 2 * width];
        let features = &mut self.features[..rows * width];
        let gradient = rows_of(&self.gradient[..rows * pairs], pairs);
        let target = view_mut(along_x, 2 * width);
        matrix::product(target, grad_x, view(&coefficients.along_x));
        let target = view_mut(along_y, 2 * width);
        matrix::product(target, grad_y, view(&coefficients.along_y));
        let target = view_mut(features, width);
        matrix::product(target, gradient, view(&coefficients.turned));
        vectorised(|| {
            for ((k1, x), y) in features
                .chunks_exact_mut(width)
                .zip(along_x.chunks_exact(2 * width))
                .zip(along_y.chunks_exact(2 * width))
            {
                let ((gx, k2), (gy, k3)) = (x.split_at(width), y.split_at(width));
                for c in 0..width {
                    k1[c] = tanh(gx[c] * (k1[c] - k3[c]) + gy[c] * (k1[c] + k2[c]));
                }
            }
        });
    }

    /// Adds a tile's share of `Φᵀ M x` to the piece's spectrum of one field.
    fn add_spectrum(
        &mut self,
        surface: &Surface,
        tile: &Range<usize>,
        piece: &mut Piece,
        field: usize,
    ) {
        let width = self.width;
        let mass = &surface.mass.as_slice().expect("vector")[tile.clone()];
        let x = &*piece.tile(field, tile, width);
        let weighted = &mut self.hidden[..x.len()];
        vectorised(|| {
            for ((out, x), mass) in weighted
                .chunks_exact_mut(width)
                .zip(x.chunks_exact(width))
                .zip(mass)
            {
                for (out, x) in out.iter_mut().zip(x) {
                    *out = x * mass;
                }
            }
        });
        let weighted = rows_of(weighted, width);
        let basis = view(&surface.evecs).subrows(tile.start, tile.len());
        let sum = piece.spectra[field].as_slice_mut().expect("new array");
        matrix::product_add(view_mut(sum, width), basis.transpose(), weighted);
    }
}

#[cfg(test)]
mod tests;
