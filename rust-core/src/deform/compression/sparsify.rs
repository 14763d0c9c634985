//! Sets weights to exactly zero if the clip stays within its error without them.
//!
//! Blender and other hosts skip a shape whose weight is zero, so a frame plays faster the fewer other
//! weights it has. A whole performance needs many shapes, but a single frame needs few.

use ndarray::{Array2, ArrayView1};
use rayon::prelude::*;

use crate::nn::matrix::{self, product, view, view_mut};

/// A frame in which at most this many shapes move is left as it is.
pub(super) const MOVING: usize = 20;
/// For each shape the error is first measured in this many regions, at the vertex that the shape
/// moves farthest. A missing shape shows there first.
const FARTHEST: usize = 48;
/// Frames whose error is measured together.
const FRAMES_PER_TASK: usize = 16;
/// The vertices of a mesh are divided into this many regions, in the order of their numbers.
const REGIONS: usize = 256;

/// Sets those weights `[T, K]` of each frame to zero that matter least, until [`MOVING`] shapes move.
/// No vertex of `flat` `[T, 3V]` gets further from its place than `max_error`, or than the largest
/// error of its frame was before. `shapes`: `[3V, K]`; `error`: the largest before. Returns the
/// largest error.
pub(super) fn sparsify(
    flat: &Array2<f32>,
    weights: &mut Array2<f32>,
    shapes: &Array2<f32>,
    max_error: f32,
    error: f32,
) -> f32 {
    let mut bounds = vec![max_error; weights.nrows()];
    if error > max_error {
        let before = errors_of_frames(flat, weights, shapes).into_iter();
        bounds = before.map(|e| e.max(max_error)).collect();
    }
    let largest = |errors: &[f32]| errors.iter().copied().fold(0.0, f32::max);
    let full = weights.clone();
    let frames: Vec<usize> = (0..weights.nrows()).collect();
    let farthest = Rows::farthest(shapes);
    farthest.sparsify(flat, weights, &frames, &bounds);
    let errors = errors_of_frames(flat, weights, shapes);
    // In some frames a vertex that was not measured moved too far: redo them with all vertices.
    let mut again = frames;
    again.retain(|&t| errors[t] > bounds[t]);
    if again.is_empty() {
        return largest(&errors);
    }
    for &t in &again {
        weights.row_mut(t).assign(&full.row(t));
    }
    let every = Rows::of((0..shapes.nrows() / 3).collect(), shapes);
    every.sparsify(flat, weights, &again, &bounds);
    largest(&errors_of_frames(flat, weights, shapes))
}

/// Some vertices, and the part of each shape that moves them.
struct Rows {
    vertices: Vec<usize>,
    /// `[K, 3n]`.
    shapes: Array2<f32>,
    /// The farthest that each shape moves any of these vertices, `[K]`.
    sizes: Vec<f32>,
}

impl Rows {
    fn of(vertices: Vec<usize>, shapes: &Array2<f32>) -> Rows {
        let count = shapes.ncols();
        let there = Array2::from_shape_fn((count, 3 * vertices.len()), |(k, i)| {
            shapes[[3 * vertices[i / 3] + i % 3, k]]
        });
        let rows = matrix::values(&there).chunks_exact(3 * vertices.len());
        Rows {
            sizes: rows.map(|row| longest_square(row).sqrt()).collect(),
            shapes: there,
            vertices,
        }
    }

    /// For each shape the vertices that it moves farthest, each from another region of the mesh.
    fn farthest(shapes: &Array2<f32>) -> Rows {
        let count = shapes.ncols();
        let region = (shapes.nrows() / 3).div_ceil(REGIONS).max(1);
        let of_region: Vec<Vec<(f32, usize)>> = matrix::values(shapes)
            .par_chunks(3 * count * region)
            .enumerate()
            .map(|(number, rows)| farthest_of_each(rows, count, number * region))
            .collect();
        let mut chosen = Vec::new();
        for k in 0..count {
            let mut ranked: Vec<(f32, usize)> = of_region.iter().map(|best| best[k]).collect();
            ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            chosen.extend(ranked.into_iter().take(FARTHEST).map(|(_, vertex)| vertex));
        }
        chosen.sort_unstable();
        chosen.dedup();
        Rows::of(chosen, shapes)
    }

    /// Sets weights of `frames` to zero as long as these vertices stay within the frames' bounds.
    fn sparsify(
        &self,
        flat: &Array2<f32>,
        weights: &mut Array2<f32>,
        frames: &[usize],
        bounds: &[f32],
    ) {
        let thinned: Vec<Vec<f32>> = frames
            .par_iter()
            .map(|&t| {
                let mut row = weights.row(t).to_vec();
                self.thin_frame(flat.row(t), &mut row, bounds[t]);
                row
            })
            .collect();
        for (&t, row) in frames.iter().zip(thinned) {
            weights.row_mut(t).assign(&ArrayView1::from(&row));
        }
    }

    fn thin_frame(&self, frame: ArrayView1<'_, f32>, weights: &mut [f32], bound: f32) {
        let mut left = self.left(frame, weights);
        let mut moving = weights.iter().filter(|w| **w != 0.0).count();
        let reach = |k: &usize| weights[*k].abs() * self.sizes[*k];
        let mut order: Vec<usize> = (0..weights.len()).collect();
        order.sort_by(|a, b| reach(a).total_cmp(&reach(b)));
        for k in order {
            if moving <= MOVING {
                break;
            }
            if weights[k] == 0.0 {
                continue;
            }
            let without = self.without(&left, k, weights[k]);
            if longest_square(&without) <= bound * bound {
                (left, weights[k]) = (without, 0.0);
                moving -= 1;
            }
        }
    }

    /// The frame minus the weighted shapes, `[3n]`.
    fn left(&self, frame: ArrayView1<'_, f32>, weights: &[f32]) -> Vec<f32> {
        let coordinates = self.vertices.iter().flat_map(|v| 3 * v..3 * v + 3);
        let mut left: Vec<f32> = coordinates.map(|c| frame[c]).collect();
        for (shape, weight) in self.shapes.rows().into_iter().zip(weights) {
            let shape = shape.to_slice().expect("row-major");
            left.iter_mut()
                .zip(shape)
                .for_each(|(l, s)| *l -= weight * s);
        }
        left
    }

    fn without(&self, left: &[f32], k: usize, weight: f32) -> Vec<f32> {
        let shape = self.shapes.row(k);
        let shape = shape.to_slice().expect("row-major");
        left.iter()
            .zip(shape)
            .map(|(l, s)| l + weight * s)
            .collect()
    }
}

/// For each of `count` shapes, the squared displacement and the number of the vertex that it moves
/// farthest. `rows` `[3n, count]` begin with vertex `first`.
fn farthest_of_each(rows: &[f32], count: usize, first: usize) -> Vec<(f32, usize)> {
    let mut best = vec![(-1.0, first); count];
    for (v, vertex) in rows.chunks_exact(3 * count).enumerate() {
        for (k, best) in best.iter_mut().enumerate() {
            let square = (0..3).map(|x| vertex[x * count + k].powi(2)).sum();
            if square > best.0 {
                *best = (square, first + v);
            }
        }
    }
    best
}

/// Square of the longest of `vectors` `[3n]`.
fn longest_square(vectors: &[f32]) -> f32 {
    let squares = vectors
        .chunks_exact(3)
        .map(|d| d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    squares.fold(0.0, f32::max)
}

/// The largest distance of any vertex from its place in each frame, `[T]`.
fn errors_of_frames(flat: &Array2<f32>, weights: &Array2<f32>, shapes: &Array2<f32>) -> Vec<f32> {
    let (frames, coordinates) = flat.dim();
    let starts: Vec<usize> = (0..frames).step_by(FRAMES_PER_TASK).collect();
    let errors_of = |&first: &usize| {
        let count = FRAMES_PER_TASK.min(frames - first);
        let weights = view(weights).subrows(first, count);
        let mut left = vec![0.0; count * coordinates];
        product(
            view_mut(&mut left, coordinates),
            weights,
            view(shapes).transpose(),
        );
        let there = matrix::values(flat)[first * coordinates..].iter();
        left.iter_mut().zip(there).for_each(|(l, t)| *l = t - *l);
        let rows = left.chunks_exact(coordinates);
        rows.map(|row| longest_square(row).sqrt())
            .collect::<Vec<f32>>()
    };
    starts.par_iter().map(errors_of).flatten_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forty shapes over `vertices`. Each frame moves all of them, some only a little.
    fn motion(frames: usize, vertices: usize) -> (Array2<f32>, Array2<f32>, Array2<f32>) {
        let shapes = Array2::from_shape_fn((3 * vertices, 40), |(c, k)| {
            ((c + 1) as f32 * (k + 1) as f32 * 0.61).sin()
        });
        let weights = Array2::from_shape_fn((frames, 40), |(t, k)| {
            let loud = ((t + 3 * k) as f32 * 0.37).sin();
            loud.powi(5) + 1e-3
        });
        (weights.dot(&shapes.t()), weights, shapes)
    }

    #[test]
    fn few_shapes_move_in_a_frame_and_every_vertex_stays_within_the_bound() {
        for vertices in [30, 3000] {
            let (flat, mut weights, shapes) = motion(50, vertices);
            let before = weights.clone();
            let error = sparsify(&flat, &mut weights, &shapes, 0.1, 0.0);
            let left = &flat - &weights.dot(&shapes.t());
            let there = longest_square(matrix::values(&left)).sqrt();
            assert!(
                error <= 0.1 && (error - there).abs() < 1e-4,
                "{error} {there}"
            );
            let moving = weights.iter().filter(|w| **w != 0.0).count();
            assert!(
                moving < before.len() * 3 / 4,
                "{moving} of {}",
                before.len()
            );
            let pairs = weights.iter().zip(&before);
            assert!(pairs.into_iter().all(|(w, b)| *w == 0.0 || w == b));
        }
    }

    #[test]
    fn a_vertex_that_was_not_asked_is_met_all_the_same() {
        // Each shape moves vertices that no other shape moves. All shapes move the last vertex a little.
        let vertices = 40 * REGIONS;
        let mut shapes = Array2::zeros((3 * vertices, 40));
        for k in 0..40 {
            for region in 0..FARTHEST {
                shapes[[3 * (40 * region + k), k]] = 1.0;
            }
            shapes[[3 * (vertices - 1), k]] = 0.19;
        }
        assert!(!Rows::farthest(&shapes).vertices.contains(&(vertices - 1)));
        let mut weights = Array2::from_elem((3, 40), 0.04);
        let flat = weights.dot(&shapes.t());
        let error = sparsify(&flat, &mut weights, &shapes, 0.05, 0.0);
        let left = &flat - &weights.dot(&shapes.t());
        assert!(longest_square(matrix::values(&left)).sqrt() <= 0.05 + 1e-6);
        assert!(error <= 0.05);
    }

    #[test]
    fn shapes_that_all_matter_stay() {
        let (flat, weights, shapes) = motion(10, 30);
        let mut sparse = weights.clone();
        sparsify(&flat, &mut sparse, &shapes, 0.0, 0.0);
        assert_eq!(sparse, weights);
    }
}
