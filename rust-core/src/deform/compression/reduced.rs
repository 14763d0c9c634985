//! Principal components of a long clip, computed within the few directions in time that matter.

use faer::{Mat, MatRef, Side};
use ndarray::{Array2, s};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{RngCore, SeedableRng},
};
use rayon::prelude::*;

use crate::{
    Error, Result,
    job::{ProgressFn, report},
    nn::matrix::{self, by_row_blocks, product, rows_of, view, view_mut},
};

/// The range finder follows this many directions more than the largest number of shapes.
const SPARE: usize = 16;
/// Vertices whose products one task sums.
const VERTICES_PER_SUM: usize = 1365;

/// Components, largest first: `weights` `[T, K]` and `shapes` `[3V, K]`.
pub(super) struct Components {
    pub weights: Array2<f32>,
    pub shapes: Array2<f32>,
}

impl Components {
    /// The first `count` of them.
    pub fn first(&self, count: usize) -> Components {
        Components {
            weights: self.weights.slice(s![.., ..count]).to_owned(),
            shapes: self.shapes.slice(s![.., ..count]).to_owned(),
        }
    }
}

/// The directions in time that matter, `range` `[T, width]`, and the clip in them, `projected`
/// `[3V, width]`.
pub(super) struct Reduced {
    range: Array2<f32>,
    projected: Array2<f32>,
    /// The most components that are kept.
    most: usize,
}

impl Reduced {
    /// Finds the directions for at most `most` components, in which each vertex counts by its weight
    /// in `weights` `[V]`.
    pub fn new(
        flat: &Array2<f32>,
        most: usize,
        weights: &[f32],
        progress: ProgressFn<'_>,
    ) -> Result<Reduced> {
        let frames = flat.nrows();
        if frames == 0 || flat.ncols() == 0 {
            return Ok(Reduced {
                range: Array2::zeros((frames, 0)),
                projected: Array2::zeros((flat.ncols(), 0)),
                most: 0,
            });
        }
        let range = match frames > most + SPARE {
            true => range_of_frames(flat, most + SPARE, weights, progress)?,
            false => Array2::eye(frames),
        };
        let projected = transposed_product(flat, &range);
        report(progress, "compress", 0.5)?;
        Ok(Reduced {
            range,
            projected,
            most,
        })
    }

    /// The components of the clip if each vertex counts by its weight in `weights` `[V]`.
    pub fn components(&self, weights: &[f32]) -> Result<Components> {
        if self.most == 0 {
            return Ok(Components {
                weights: self.range.clone(),
                shapes: self.projected.clone(),
            });
        }
        let rotation = principal_axes(&self.projected, weights)?;
        let keep = self.most.min(rotation.ncols());
        let rotation = rotation.slice(s![.., ..keep]).to_owned();
        Ok(Components {
            weights: row_product(&self.range, &rotation),
            shapes: row_product(&self.projected, &rotation),
        })
    }
}

/// Orthonormal `[T, width]` whose columns nearly span the frames of the clip in which the
/// coordinates of each vertex are multiplied by the root of its weight.
fn range_of_frames(
    flat: &Array2<f32>,
    width: usize,
    weights: &[f32],
    progress: ProgressFn<'_>,
) -> Result<Array2<f32>> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let uniform = 2.0f32.powi(-31);
    let probe = Array2::from_shape_fn((flat.ncols(), width), |(row, _)| {
        (rng.next_u32() as f32 * uniform - 1.0) * weights[row / 3].sqrt()
    });
    let first = orthonormal(&row_product(flat, &probe));
    report(progress, "compress", 0.2)?;
    let mut back = transposed_product(flat, &first);
    for (row, mut values) in back.rows_mut().into_iter().enumerate() {
        values *= weights[row / 3];
    }
    report(progress, "compress", 0.35)?;
    Ok(orthonormal(&row_product(flat, &back)))
}

/// `lhs · rhs`, row blocks in parallel.
fn row_product(lhs: &Array2<f32>, rhs: &Array2<f32>) -> Array2<f32> {
    by_row_blocks(lhs.nrows(), rhs.ncols(), |rows, out| {
        let lhs = view(lhs).subrows(rows.start, rows.len());
        product(view_mut(out, rhs.ncols()), lhs, view(rhs));
    })
}

/// `lhsᵀ · rhs`, row blocks of the result in parallel.
fn transposed_product(lhs: &Array2<f32>, rhs: &Array2<f32>) -> Array2<f32> {
    by_row_blocks(lhs.ncols(), rhs.ncols(), |rows, out| {
        let lhs = view(lhs).subcols(rows.start, rows.len()).transpose();
        product(view_mut(out, rhs.ncols()), lhs, view(rhs));
    })
}

/// An orthonormal basis of the columns of `[T, width]`, `T` at least `width`.
fn orthonormal(columns: &Array2<f32>) -> Array2<f32> {
    let (rows, width) = columns.dim();
    let matrix = Mat::from_fn(rows, width, |i, j| f64::from(columns[[i, j]]));
    let q = matrix.qr().compute_thin_Q();
    Array2::from_shape_fn((rows, width), |(i, j)| q[(i, j)] as f32)
}

/// Eigenvectors of `Pᵀ W P` for `P` `[3V, width]` and `weights` `[V]`, largest first: `[width, width]`.
fn principal_axes(projected: &Array2<f32>, weights: &[f32]) -> Result<Array2<f32>> {
    let width = projected.ncols();
    let sums: Vec<Vec<f32>> = matrix::values(projected)
        .par_chunks(3 * VERTICES_PER_SUM * width)
        .zip(weights.par_chunks(VERTICES_PER_SUM))
        .map(|(rows, weights)| {
            let mut scaled = rows.to_vec();
            for (rows, weight) in scaled.chunks_exact_mut(3 * width).zip(weights) {
                let root = weight.sqrt();
                rows.iter_mut().for_each(|x| *x *= root);
            }
            let rows: MatRef<'_, f32> = rows_of(&scaled, width);
            let mut sum = vec![0.0; width * width];
            product(view_mut(&mut sum, width), rows.transpose(), rows);
            sum
        })
        .collect();
    let mut gram = Mat::<f64>::zeros(width, width);
    for sum in &sums {
        for i in 0..width {
            for j in 0..width {
                gram[(i, j)] += f64::from(sum[i * width + j]);
            }
        }
    }
    let eigen = gram
        .self_adjoint_eigen(Side::Lower)
        .map_err(|e| Error::Numerics(format!("compression: eigenvalues of frames: {e:?}")))?;
    Ok(Array2::from_shape_fn((width, width), |(i, j)| {
        eigen.U()[(i, width - 1 - j)] as f32
    }))
}
