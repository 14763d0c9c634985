//! Principal components of a clip in which some vertices and some frames count more than others.

use faer::{Mat, MatRef, Side};
use ndarray::{Array2, Axis, s};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{RngCore, SeedableRng},
};
use rayon::prelude::*;

use crate::{
    Error, Result,
    job::Watch,
    nn::matrix::{self, by_row_blocks, product, rows_of, view, view_mut},
};

/// Vertices whose products one task sums.
const VERTICES_PER_SUM: usize = 1365;

/// How much each frame `[T]` and each vertex `[V]` counts; the mean of both is 1.
#[derive(Clone)]
pub(super) struct Importance {
    pub frames: Vec<f32>,
    pub vertices: Vec<f32>,
}

/// Components `D ≈ weights · shapesᵀ` of displacements `[T, 3V]`, largest first.
pub(super) struct Components {
    /// `[T, K]`.
    pub weights: Array2<f32>,
    /// `[3V, K]`.
    pub shapes: Array2<f32>,
    /// `[T, K]`: the products of these with the frames of a vertex are its part of the shapes.
    pub duals: Array2<f32>,
}

impl Components {
    /// No components of `frames` frames and `coordinates` coordinates.
    pub fn none(frames: usize, coordinates: usize) -> Components {
        Components {
            weights: Array2::zeros((frames, 0)),
            shapes: Array2::zeros((coordinates, 0)),
            duals: Array2::zeros((frames, 0)),
        }
    }

    /// Finds `width` components of `flat` `[T, 3V]`, or `T` if these are fewer.
    ///
    /// With `A` and `B` for the importance of frames and vertices, `A^½ D B^½` has left singular
    /// vectors `U`. Then the weights are `A^-½ U` and the duals `A^½ U`. Vectors near `U` come from
    /// a range finder with one power iteration (Halko, Martinsson, Tropp 2011, algorithm 4.4), which
    /// begins with the components `near`.
    pub fn find(
        flat: &Array2<f32>,
        importance: &Importance,
        width: usize,
        near: Option<&Components>,
        watch: &Watch<'_>,
    ) -> Result<Components> {
        let frames = flat.nrows();
        let roots: Vec<f32> = importance.frames.iter().map(|a| a.sqrt()).collect();
        let range = if frames > width {
            range_of_frames(flat, importance, &roots, width, near, watch)?
        } else {
            Array2::eye(frames)
        };
        watch.check()?;
        let projected = transposed_product(flat, &scaled(&range, &roots), watch);
        watch.check()?;
        let rotation = principal_axes(&projected, &importance.vertices)?;
        let axes = row_product(&range, &rotation, watch);
        let inverse: Vec<f32> = roots.iter().map(|root| root.recip()).collect();
        Ok(Components {
            weights: scaled(&axes, &inverse),
            shapes: row_product(&projected, &rotation, watch),
            duals: scaled(&axes, &roots),
        })
    }

    /// The first `count` of them.
    pub fn first(&self, count: usize) -> Components {
        let first = |all: &Array2<f32>| all.slice(s![.., ..count]).to_owned();
        Components {
            weights: first(&self.weights),
            shapes: first(&self.shapes),
            duals: first(&self.duals),
        }
    }

    /// The first `count` of them, with shapes for the vertices of `flat` `[T, 3V]`. If the job is
    /// cancelled, the shapes stay unfinished.
    pub fn on(&self, flat: &Array2<f32>, count: usize, watch: &Watch<'_>) -> Components {
        let duals = self.duals.slice(s![.., ..count]).to_owned();
        Components {
            weights: self.weights.slice(s![.., ..count]).to_owned(),
            shapes: transposed_product(flat, &duals, watch),
            duals,
        }
    }
}

/// Orthonormal `[T, width]` whose columns nearly span the weighted frames of `flat` `[T, 3V]`.
/// `roots` `[T]`: of the importance of the frames.
fn range_of_frames(
    flat: &Array2<f32>,
    importance: &Importance,
    roots: &[f32],
    width: usize,
    near: Option<&Components>,
    watch: &Watch<'_>,
) -> Result<Array2<f32>> {
    let weights = &importance.vertices;
    let first = match near {
        Some(near) if near.duals.ncols() >= width => {
            scaled(&near.weights.slice(s![.., ..width]).to_owned(), roots)
        }
        _ => {
            let mut rng = ChaCha8Rng::seed_from_u64(0);
            let uniform = 2.0f32.powi(-31);
            let probe = Array2::from_shape_fn((flat.ncols(), width), |(row, _)| {
                (rng.next_u32() as f32 * uniform - 1.0) * weights[row / 3].sqrt()
            });
            scaled(&row_product(flat, &probe, watch), roots)
        }
    };
    watch.check()?;
    let first = scaled(&orthonormal(&first), roots);
    let mut back = transposed_product(flat, &first, watch);
    for (row, mut values) in back.rows_mut().into_iter().enumerate() {
        values *= weights[row / 3];
    }
    let range = scaled(&row_product(flat, &back, watch), roots);
    watch.check()?;
    Ok(orthonormal(&range))
}

/// `rows` `[T, K]`, each multiplied by its factor.
fn scaled(rows: &Array2<f32>, factors: &[f32]) -> Array2<f32> {
    let mut out = rows.clone();
    for (mut row, factor) in out.axis_iter_mut(Axis(0)).zip(factors) {
        row *= *factor;
    }
    out
}

/// `lhs · rhs`, row blocks in parallel. Unfinished if the job is cancelled.
fn row_product(lhs: &Array2<f32>, rhs: &Array2<f32>, watch: &Watch<'_>) -> Array2<f32> {
    by_row_blocks(lhs.nrows(), rhs.ncols(), |rows, out| {
        let lhs = view(lhs).subrows(rows.start, rows.len());
        if watch.is_wanted() {
            product(view_mut(out, rhs.ncols()), lhs, view(rhs));
        }
    })
}

/// `lhsᵀ · rhs`, row blocks of the result in parallel. Unfinished if the job is cancelled.
fn transposed_product(lhs: &Array2<f32>, rhs: &Array2<f32>, watch: &Watch<'_>) -> Array2<f32> {
    by_row_blocks(lhs.ncols(), rhs.ncols(), |rows, out| {
        let lhs = view(lhs).subcols(rows.start, rows.len()).transpose();
        if watch.is_wanted() {
            product(view_mut(out, rhs.ncols()), lhs, view(rhs));
        }
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
