//! The pass over the vertices, in pieces for the threads and tiles for the cache.

use std::ops::Range;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::block::{Block, Coefficients};
use crate::{
    job::Watch,
    nn::{
        elementwise::{tanh, vectorised},
        linear::Linear,
        matrix::{self, rows_of, view, view_mut},
        panels::{Finish, Start},
        surface::Surface,
    },
};

/// Rows processed at once. Their operators and intermediate fields stay in a cache of 1 MB. A
/// multiple of the rows that `Panels` sums at once.
const TILE: usize = 120;
/// The most pieces of parallel work. The number of threads does not change the pieces, so sums over
/// vertices always run in the same order.
const PIECES: usize = 32;

/// All fields of a batch, cut into pieces by vertices.
pub(super) struct Fields<'a> {
    surface: &'a Surface,
    width: usize,
    /// If the job is cancelled, the rest of the values stays unfinished.
    watch: &'a Watch<'a>,
    pub(super) pieces: Vec<Piece>,
}

/// Some consecutive vertices of every field.
pub(super) struct Piece {
    rows: Range<usize>,
    /// One `[rows, C]` per field.
    pub(super) fields: Vec<Vec<f32>>,
    /// This piece's share of `Φᵀ M x`, one `[K, C]` per field.
    spectra: Vec<Array2<f32>>,
}

impl<'a> Fields<'a> {
    pub(super) fn new(
        batch: usize,
        width: usize,
        surface: &'a Surface,
        watch: &'a Watch<'a>,
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
                    for tile in tiles(rows).take_while(|_| watch.is_wanted()) {
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
            watch,
            pieces,
        }
    }

    /// Applies one block to every field. `spectra`: whether another block follows and needs the
    /// spectra.
    pub(super) fn apply(&mut self, block: &Block, spectra: bool) {
        let (surface, width, watch) = (self.surface, self.width, self.watch);
        let coefficients: Vec<Coefficients> = (0..self.batch())
            .into_par_iter()
            .map(|field| block.coefficients(self.spectrum(field), &surface.evals))
            .collect();
        self.pieces.par_iter_mut().for_each_init(
            || Workspace::new(surface, width),
            |work, piece| {
                piece.spectra.iter_mut().for_each(|s| s.fill(0.0));
                for tile in tiles(piece.rows.clone()).take_while(|_| watch.is_wanted()) {
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

    /// Applies a linear layer to every field. Returns `[B, V, out]`.
    pub(super) fn project(&self, last: &Linear) -> Array3<f32> {
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
    /// `gx`, `gy`, `k₁`, `k₂` and `k₃`, `[rows, C]` each.
    parts: [Vec<f32>; 5],
    /// Gradient features, then the second hidden layer, `[rows, C]`.
    features: Vec<f32>,
    /// First hidden layer, then `M x`, `[rows, C]`.
    hidden: Vec<f32>,
}

impl Workspace {
    fn new(surface: &Surface, width: usize) -> Self {
        let rows = TILE.min(surface.vertices());
        let field = || vec![0.0; rows * width];
        Workspace {
            width,
            gradient: vec![0.0; rows * surface.eigenpairs()],
            parts: std::array::from_fn(|_| field()),
            features: field(),
            hidden: field(),
        }
    }

    /// Computes `(G_x + G_y) Φ` of a tile, once for all fields.
    fn add_gradients(&mut self, surface: &Surface, tile: &Range<usize>) {
        let (x, y) = (of(&surface.grad_x, tile), of(&surface.grad_y, tile));
        let sum = &mut self.gradient[..x.len()];
        vectorised(
            #[inline(always)]
            || {
                for ((sum, x), y) in sum.iter_mut().zip(x).zip(y) {
                    *sum = x + y;
                }
            },
        );
    }

    /// Applies one block to a tile of one field `x`, `[rows, C]`, in place.
    fn block(
        &mut self,
        block: &Block,
        coefficients: &Coefficients,
        surface: &Surface,
        tile: &Range<usize>,
        x: &mut [f32],
    ) {
        self.gradient_features(coefficients, surface, tile);
        let features = &mut self.features[..x.len()];
        let hidden = &mut self.hidden[..x.len()];
        let [first, middle, last] = &block.biases;
        let diffused = of(&surface.evecs, tile);
        let mixed = &coefficients.mixed;
        let from_x = &block.from_x;
        from_x.multiply(x, Start::Row(first), Finish::Plain, hidden);
        mixed.multiply(diffused, Start::Output, Finish::Plain, hidden);
        let from_features = &block.from_features;
        from_features.multiply(features, Start::Output, Finish::Relu, hidden);
        let weight = &block.middle;
        weight.multiply(hidden, Start::Row(middle), Finish::Relu, features);
        let weight = &block.last;
        weight.multiply(features, Start::OutputAndRow(last), Finish::Plain, x);
    }

    /// Writes `tanh(gx Re(A g) + gy Im(A g))`, eq. 8, to `features`.
    fn gradient_features(
        &mut self,
        coefficients: &Coefficients,
        surface: &Surface,
        tile: &Range<usize>,
    ) {
        let size = tile.len() * self.width;
        let [gx, gy, k1, k2, k3] = self.parts.each_mut().map(|part| &mut part[..size]);
        let (along_x, along_y) = (of(&surface.grad_x, tile), of(&surface.grad_y, tile));
        let both = &self.gradient[..along_x.len()];
        let Coefficients {
            diffused,
            turned,
            difference,
            sum,
            ..
        } = coefficients;
        let (zero, plain) = (Start::Zero, Finish::Plain);
        diffused.multiply(along_x, zero, plain, gx);
        diffused.multiply(along_y, zero, plain, gy);
        turned.multiply(both, zero, plain, k1);
        difference.multiply(along_x, zero, plain, k2);
        sum.multiply(along_y, zero, plain, k3);
        let features = &mut self.features[..size];
        vectorised(
            #[inline(always)]
            || {
                let parts = gx.iter().zip(gy).zip(k1).zip(k2).zip(k3);
                for (feature, ((((gx, gy), k1), k2), k3)) in features.iter_mut().zip(parts) {
                    *feature = tanh(*gx * (*k1 - *k3) + *gy * (*k1 + *k2));
                }
            },
        );
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
        vectorised(
            #[inline(always)]
            || {
                let rows = weighted.chunks_exact_mut(width).zip(x.chunks_exact(width));
                for ((out, x), mass) in rows.zip(mass) {
                    for (out, x) in out.iter_mut().zip(x) {
                        *out = x * mass;
                    }
                }
            },
        );
        let weighted = rows_of(weighted, width);
        let basis = view(&surface.evecs).subrows(tile.start, tile.len());
        let sum = piece.spectra[field].as_slice_mut().expect("new array");
        matrix::product_add(view_mut(sum, width), basis.transpose(), weighted);
    }
}

/// The rows of a tile.
fn of<'a>(basis: &'a Array2<f32>, tile: &Range<usize>) -> &'a [f32] {
    let columns = basis.ncols();
    &matrix::values(basis)[tile.start * columns..tile.end * columns]
}
