//! A moving mesh as a few shapes and their weights over time.
//!
//! Displacements `D` `[T, 3V]` become `weights · shapes` with as few shapes as keep every vertex in
//! every frame within a stated distance of its place. The shapes are principal components without
//! centring, so that zero weights are the neutral mesh. Long clips go through a randomised range
//! finder with one power iteration (Halko, Martinsson, Tropp 2011, algorithm 4.4); the error that
//! is reported is measured on the result, not estimated.

use faer::{Mat, MatRef, Side};
use ndarray::{Array2, Array3};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{RngCore, SeedableRng},
};
use rayon::prelude::*;

use super::VertexClip;
use crate::{
    Error, Result,
    nn::matrix::{self, by_row_blocks, product, rows_of, view, view_mut},
    progress::{ProgressFn, report},
};

/// Directions beyond the largest number of shapes that the range finder follows.
const SPARE: usize = 16;
/// Vertices whose error is measured together.
const VERTICES_PER_TASK: usize = 128;
/// Components of a performance that nearly suffice: where the search for their number begins.
const FIRST_COUNT: usize = 32;
/// Vertices summed in one go where a long axis is reduced.
const VERTICES_PER_SUM: usize = 1365;
/// Up to this many shapes nobody looks for fewer; rounds in which fewer are looked for.
const FEW: usize = 40;
const ROUNDS: usize = 3;
/// The least by which a round changes a vertex' weight.
const LEAST_EXCESS: f32 = 0.05;

/// A clip as `weights · shapes`.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexBasis {
    /// `[K, V, 3]`, mesh units: the displacement at weight 1.
    pub shapes: Array3<f32>,
    /// `[T, K]`, each shape's weights within [−1, 1] and touching one of the ends.
    pub weights: Array2<f32>,
    /// Largest distance of any vertex in any frame from where the clip has it, mesh units.
    pub max_error: f32,
    /// Frames per second.
    pub fps: f64,
}

impl VertexBasis {
    /// `[T, V, 3]`: `weights · shapes`, mesh units.
    pub fn displacements(&self) -> Array3<f32> {
        let (shapes, vertices, _) = self.shapes.dim();
        let flat = self
            .shapes
            .to_shape((shapes, 3 * vertices))
            .expect("row-major");
        let moved = self.weights.dot(&flat);
        moved
            .into_shape_with_order((self.weights.nrows(), vertices, 3))
            .expect("the same number of values")
    }
}

/// Few principal shapes that keep every vertex within `max_error` of its place, at most
/// `max_shapes`.
///
/// `max_error`: mesh units, at least 0. If `max_shapes` do not suffice the result says so by its
/// own `max_error`. A clip that does not move has no shapes.
///
/// # Errors
/// `InvalidInput` for a negative `max_error`, no shapes, or displacements that are not finite;
/// `Cancelled`.
pub fn compress(
    clip: &VertexClip,
    max_error: f32,
    max_shapes: usize,
    progress: ProgressFn<'_>,
) -> Result<VertexBasis> {
    if max_error.is_nan() || max_error < 0.0 || max_shapes == 0 {
        return Err(Error::InvalidInput(format!(
            "compression: expected an error of at least 0 and at least one shape, got {max_error} \
             and {max_shapes}"
        )));
    }
    let (frames, vertices, _) = clip.displacements.dim();
    let flat = clip.displacements.to_shape((frames, 3 * vertices));
    let flat = flat.expect("the same number of values").into_owned();
    if flat.iter().any(|x| !x.is_finite()) {
        let message = "compression: expected finite displacements, got NaN or infinity";
        return Err(Error::InvalidInput(message.into()));
    }
    report(progress, "compress", 0.0)?;
    let reduced = Reduced::new(&flat, max_shapes.min(frames), progress)?;
    let mut weights = vec![1.0; vertices];
    let all: Vec<usize> = (0..vertices).step_by(VERTICES_PER_TASK).collect();
    let full = reduced.components(&weights)?;
    let (count, error) = fewest(&flat, &full, max_error, FIRST_COUNT, &all);
    let mut best = Choice { full, count, error };
    for round in 0..ROUNDS {
        report(progress, "compress", 0.6 + 0.1 * round as f32)?;
        if best.count <= FEW || best.error > max_error {
            break;
        }
        let fewer = best.count * 3 / 4;
        let left = errors_of_vertices(&flat, &best.full, fewer, &all);
        emphasise(&mut weights, &left, max_error);
        let full = reduced.components(&weights)?;
        // The error is largest where it was large before: only there is it measured in between.
        let worst = worst_tasks(&left, &all);
        let (count, _) = fewest(&flat, &full, max_error, fewer, &worst);
        let error = largest_error(&flat, &full, count, &all);
        if error <= max_error && count < best.count {
            best = Choice { full, count, error };
        }
    }
    report(progress, "compress", 1.0)?;
    Ok(normalised(&best, vertices, clip.fps))
}

/// Components in falling order: `weights` `[T, K]` and `shapes` `[3V, K]`.
struct Components {
    weights: Array2<f32>,
    shapes: Array2<f32>,
}

/// The clip in the directions in time that matter, `range` `[T, width]`: `projected` `[3V, width]`.
struct Reduced {
    range: Array2<f32>,
    projected: Array2<f32>,
    /// The most components that are kept.
    most: usize,
}

impl Reduced {
    fn new(flat: &Array2<f32>, most: usize, progress: ProgressFn<'_>) -> Result<Reduced> {
        let frames = flat.nrows();
        if frames == 0 || flat.ncols() == 0 {
            return Ok(Reduced {
                range: Array2::zeros((frames, 0)),
                projected: Array2::zeros((flat.ncols(), 0)),
                most: 0,
            });
        }
        let range = match frames > most + SPARE {
            true => range_of_frames(flat, most + SPARE, progress)?,
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

    /// The components of the clip with every vertex taken as often as `weights` `[V]` says.
    fn components(&self, weights: &[f32]) -> Result<Components> {
        if self.most == 0 {
            return Ok(Components {
                weights: self.range.clone(),
                shapes: self.projected.clone(),
            });
        }
        let rotation = principal_axes(&self.projected, weights)?;
        let keep = self.most.min(rotation.ncols());
        let rotation = rotation.slice(ndarray::s![.., ..keep]).to_owned();
        Ok(Components {
            weights: row_product(&self.range, &rotation),
            shapes: row_product(&self.projected, &rotation),
        })
    }
}

/// Components, and how many of them it takes.
struct Choice {
    full: Components,
    count: usize,
    error: f32,
}

/// Gives vertices more weight the further they are from their place (`left` `[V]`, squared).
///
/// Principal components make the sum of squares small; what is asked is that no vertex be far off,
/// which iterated weights come nearer to (Lawson 1961).
fn emphasise(weights: &mut [f32], left: &[f32], max_error: f32) {
    for (weight, left) in weights.iter_mut().zip(left) {
        let excess = (left.sqrt() / max_error.max(f32::MIN_POSITIVE)).clamp(LEAST_EXCESS, 1e3);
        *weight *= excess;
    }
    let mean = weights.iter().sum::<f32>() / weights.len().max(1) as f32;
    weights.iter_mut().for_each(|weight| *weight /= mean);
}

/// Orthonormal `[T, width]` whose columns nearly span the frames.
fn range_of_frames(
    flat: &Array2<f32>,
    width: usize,
    progress: ProgressFn<'_>,
) -> Result<Array2<f32>> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let uniform = 2.0f32.powi(-31);
    let probe = Array2::from_shape_fn((flat.ncols(), width), |_| {
        rng.next_u32() as f32 * uniform - 1.0
    });
    let first = orthonormal(&row_product(flat, &probe));
    report(progress, "compress", 0.2)?;
    let back = transposed_product(flat, &first);
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

/// The fewest components that leave at most `max_error`, and what they leave; all where none do.
///
/// What is left falls with the number of components, so it is looked for by doubling and halving
/// from `guess` on.
fn fewest(
    flat: &Array2<f32>,
    full: &Components,
    max_error: f32,
    guess: usize,
    tasks: &[usize],
) -> (usize, f32) {
    let most = full.shapes.ncols();
    let left = |count| largest_error(flat, full, count, tasks);
    let (mut few, mut many, mut error) = (0, 0, left(0));
    while error > max_error && many < most {
        few = many;
        many = (2 * many).clamp(guess.min(most), most);
        error = left(many);
    }
    while error <= max_error && many - few > 1 {
        let middle = few.midpoint(many);
        let error_there = left(middle);
        match error_there <= max_error {
            true => (many, error) = (middle, error_there),
            false => few = middle,
        }
    }
    (many, error)
}

/// The largest distance of any vertex in any frame from where the first `count` components have it.
fn largest_error(flat: &Array2<f32>, full: &Components, count: usize, tasks: &[usize]) -> f32 {
    let squares = errors_of_vertices(flat, full, count, tasks);
    squares.into_iter().fold(0.0, f32::max).sqrt()
}

/// The same for each vertex, squared; of the tasks that begin with the vertices `tasks`.
fn errors_of_vertices(
    flat: &Array2<f32>,
    full: &Components,
    count: usize,
    tasks: &[usize],
) -> Vec<f32> {
    let (frames, coordinates) = flat.dim();
    let weights = view(&full.weights).subcols(0, count);
    let errors_of = |&first: &usize| {
        let columns = 3 * VERTICES_PER_TASK.min(coordinates / 3 - first);
        let shapes = view(&full.shapes).subrows(3 * first, columns);
        let mut fitted = vec![0.0; frames * columns];
        if count > 0 {
            let shapes = shapes.subcols(0, count).transpose();
            product(view_mut(&mut fitted, columns), weights, shapes);
        }
        let mut longest = vec![0.0; columns / 3];
        let rows = matrix::values(flat).chunks_exact(coordinates);
        for (row, fitted) in rows.zip(fitted.chunks_exact(columns)) {
            raise_to_distance(&mut longest, &row[3 * first..3 * first + columns], fitted);
        }
        longest
    };
    tasks.par_iter().map(errors_of).flatten_iter().collect()
}

/// The sixteenth of `tasks` with the largest errors; `left` holds those of all their vertices.
fn worst_tasks(left: &[f32], tasks: &[usize]) -> Vec<usize> {
    let largest = |task: &[f32]| task.iter().copied().fold(0.0, f32::max);
    let errors = left.chunks(VERTICES_PER_TASK).map(largest);
    let mut ranked: Vec<(f32, usize)> = errors.zip(tasks.iter().copied()).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    ranked.truncate(tasks.len().div_ceil(16));
    ranked.into_iter().map(|(_, task)| task).collect()
}

/// Raises `longest` `[n]` to the squared distances of `there` `[n, 3]` and `fitted` `[n, 3]`.
fn raise_to_distance(longest: &mut [f32], there: &[f32], fitted: &[f32]) {
    let pairs = there.chunks_exact(3).zip(fitted.chunks_exact(3));
    for (longest, (a, b)) in longest.iter_mut().zip(pairs) {
        let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        *longest = longest.max(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    }
}

/// The chosen components with weights that touch ±1.
fn normalised(choice: &Choice, vertices: usize, fps: f64) -> VertexBasis {
    let (full, count) = (&choice.full, choice.count);
    let frames = full.weights.nrows();
    let scale: Vec<f32> = (0..count)
        .map(|k| {
            let column = full.weights.column(k);
            let largest = column.iter().fold(0.0f32, |m, w| m.max(w.abs()));
            if largest > 0.0 { largest } else { 1.0 }
        })
        .collect();
    VertexBasis {
        shapes: Array3::from_shape_fn((count, vertices, 3), |(k, v, x)| {
            scale[k] * full.shapes[[3 * v + x, k]]
        }),
        weights: Array2::from_shape_fn((frames, count), |(t, k)| {
            (full.weights[[t, k]] / scale[k]).clamp(-1.0, 1.0)
        }),
        max_error: choice.error,
        fps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::SILENT;

    /// Three smooth motions over `vertices`, and a small fourth.
    fn clip(frames: usize, vertices: usize) -> VertexClip {
        let displacements = Array3::from_shape_fn((frames, vertices, 3), |(t, v, x)| {
            let (t, v) = (t as f32 * 0.21, v as f32 * 0.37 + x as f32);
            let small = 1e-3 * (1.7 * t).cos() * (0.3 * v).sin();
            t.sin() * v.cos() + 0.3 * (2.3 * t).sin() * (2.0 * v).sin() + small
        });
        VertexClip {
            displacements,
            fps: 30.0,
        }
    }

    fn largest_difference(a: &Array3<f32>, b: &Array3<f32>) -> f32 {
        let squares = (a - b).mapv(|x| x * x).sum_axis(ndarray::Axis(2));
        squares.iter().fold(0.0f32, |m, &x| m.max(x)).sqrt()
    }

    #[test]
    fn stated_error_is_the_true_one_and_within_the_bound() {
        for (frames, vertices) in [(12, 50), (400, 300)] {
            let clip = clip(frames, vertices);
            for bound in [0.5, 0.01, 1e-4] {
                let basis = compress(&clip, bound, 32, SILENT).unwrap();
                let true_error = largest_difference(&basis.displacements(), &clip.displacements);
                assert!(basis.max_error <= bound, "{} of {bound}", basis.max_error);
                assert!((basis.max_error - true_error).abs() < 1e-5);
            }
            assert_eq!(
                compress(&clip, 0.01, 32, SILENT).unwrap().weights.ncols(),
                2
            );
        }
    }

    #[test]
    fn weights_touch_one_and_neutral_stays_neutral() {
        let mut moving = clip(60, 40);
        let first = ndarray::Axis(0);
        moving.displacements.index_axis_mut(first, 0).fill(0.0);
        let basis = compress(&moving, 1e-3, 32, SILENT).unwrap();
        for column in basis.weights.columns() {
            let largest = column.iter().fold(0.0f32, |m, w| m.max(w.abs()));
            assert!((largest - 1.0).abs() < 1e-6);
            assert!(column[0].abs() < 1e-4);
        }
    }

    #[test]
    fn still_and_empty_clips_have_no_shapes_and_bad_ones_are_errors() {
        for shape in [(5, 7, 3), (0, 7, 3), (5, 0, 3)] {
            let still = VertexClip {
                displacements: Array3::zeros(shape),
                fps: 30.0,
            };
            let basis = compress(&still, 0.0, 8, SILENT).unwrap();
            assert_eq!((basis.weights.dim(), basis.max_error), ((shape.0, 0), 0.0));
        }
        let mut bad = clip(5, 7);
        bad.displacements[[2, 3, 1]] = f32::NAN;
        assert!(compress(&bad, 0.1, 8, SILENT).is_err());
        assert!(compress(&clip(5, 7), -1.0, 8, SILENT).is_err());
    }

    #[test]
    fn too_few_shapes_are_reported_by_their_error() {
        let basis = compress(&clip(100, 60), 1e-6, 1, SILENT).unwrap();
        assert_eq!(basis.weights.ncols(), 1);
        assert!(basis.max_error > 0.1);
    }
}
