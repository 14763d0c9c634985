//! The pass over the vertices: pieces for the threads, tiles for the cache.

use std::ops::Range;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::{Block, Coefficients, GROUP, Group};
use crate::nn::{
    elementwise::{add_to_rows, relu_all, tanh, vectorised},
    linear::Linear,
    matrix::{self, rows_of},
    panels::{Panels, Start},
    surface::Surface,
};

/// Rows that are worked on at once: their operators and intermediate fields fit a 1 MB cache.
const TILE: usize = 256;
/// At most this many pieces of parallel work, whatever the number of threads, so that sums over
/// vertices are always taken in the same order.
const PIECES: usize = 64;

/// All fields of a batch, cut into pieces by vertices.
pub struct Fields<'a> {
    surface: &'a Surface,
    width: usize,
    pub pieces: Vec<Piece>,
}

/// Some consecutive vertices of every field.
pub struct Piece {
    rows: Range<usize>,
    /// For each field `[rows, C]`.
    pub fields: Vec<Vec<f32>>,
    /// For each field this piece's share of `Φᵀ M x`, `[K, C]`.
    spectra: Vec<Array2<f32>>,
}

impl<'a> Fields<'a> {
    /// What `first` writes for each field and range of vertices, `[rows, C]`, and its spectra.
    pub fn new(
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
    pub fn apply(&mut self, block: &Block, spectra: bool) {
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
    pub fn project(&self, last: &Linear) -> Array3<f32> {
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
    /// `gx` and `k₂` of a group, `[rows, 2 G]`.
    along_x: Vec<f32>,
    /// `gy` and `k₃` of a group, `[rows, 2 G]`.
    along_y: Vec<f32>,
    /// `k₁` of a group, `[rows, G]`.
    turned: Vec<f32>,
    /// The gradient features, then the second hidden layer, `[rows, C]`.
    features: Vec<f32>,
    /// First hidden layer, `[rows, C]`.
    hidden: Vec<f32>,
    /// `M x`, `[rows, C]`.
    weighted: Panels,
}

impl Workspace {
    fn new(surface: &Surface, width: usize) -> Self {
        let rows = TILE.min(surface.vertices());
        let group = GROUP.min(width);
        Workspace {
            width,
            gradient: vec![0.0; rows * surface.eigenpairs()],
            along_x: vec![0.0; rows * 2 * group],
            along_y: vec![0.0; rows * 2 * group],
            turned: vec![0.0; rows * group],
            features: vec![0.0; rows * width],
            hidden: vec![0.0; rows * width],
            weighted: Panels::zeros(rows, width),
        }
    }

    /// `(G_x + G_y) Φ` of a tile, once for all fields.
    fn add_gradients(&mut self, surface: &Surface, tile: &Range<usize>) {
        let (x, y) = (of(&surface.grad_x, tile), of(&surface.grad_y, tile));
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
        for (index, group) in coefficients.groups.iter().enumerate() {
            self.gradient_features(group, index * GROUP, surface, tile);
        }
        let (features, hidden) = (&mut self.features[..x.len()], &mut self.hidden[..x.len()]);
        let [first, middle, last] = &block.biases;
        block.from_x.multiply(x, Start::Row(first), hidden);
        let diffused = &coefficients.mixed;
        diffused.multiply(of(&surface.evecs, tile), Start::Output, hidden);
        block
            .from_features
            .multiply(features, Start::Output, hidden);
        relu_all(hidden);
        block.middle.multiply(hidden, Start::Row(middle), features);
        relu_all(features);
        block.last.multiply(features, Start::Output, x);
        add_to_rows(x, last);
    }

    /// `tanh(gx Re(A g) + gy Im(A g))`, eq. 8, of the channels of a group, into `features`.
    fn gradient_features(
        &mut self,
        group: &Group,
        first: usize,
        surface: &Surface,
        tile: &Range<usize>,
    ) {
        let (rows, width, channels) = (tile.len(), self.width, group.turned.columns());
        let along_x = &mut self.along_x[..rows * 2 * channels];
        let along_y = &mut self.along_y[..rows * 2 * channels];
        let turned = &mut self.turned[..rows * channels];
        let gradient = &self.gradient[..rows * surface.eigenpairs()];
        let (x, y) = (of(&surface.grad_x, tile), of(&surface.grad_y, tile));
        group.along_x.multiply(x, Start::Zero, along_x);
        group.along_y.multiply(y, Start::Zero, along_y);
        group.turned.multiply(gradient, Start::Zero, turned);
        let features = self.features.chunks_exact_mut(width);
        let features = features.map(|row| &mut row[first..first + channels]);
        vectorised(|| {
            for (((out, k1), x), y) in features
                .zip(turned.chunks_exact(channels))
                .zip(along_x.chunks_exact(2 * channels))
                .zip(along_y.chunks_exact(2 * channels))
            {
                let ((gx, k2), (gy, k3)) = (x.split_at(channels), y.split_at(channels));
                for c in 0..channels {
                    out[c] = tanh(gx[c] * (k1[c] - k3[c]) + gy[c] * (k1[c] + k2[c]));
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
        let mass = &surface.mass.as_slice().expect("vector")[tile.clone()];
        let x = &*piece.tile(field, tile, self.width);
        self.weighted.fill_scaled(x, mass);
        let sum = piece.spectra[field].as_slice_mut().expect("new array");
        self.weighted.add_transposed(of(&surface.evecs, tile), sum);
    }
}

/// The rows of a tile.
fn of<'a>(basis: &'a Array2<f32>, tile: &Range<usize>) -> &'a [f32] {
    let columns = basis.ncols();
    &matrix::values(basis)[tile.start * columns..tile.end * columns]
}
