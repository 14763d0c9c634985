//! Sets weights to exactly zero if the clip stays within its error without them.
//!
//! Blender and other hosts skip a shape whose weight is zero, so a frame plays faster the fewer other
//! weights it has. A whole performance needs many shapes, but a single frame needs few.

use ndarray::{Array2, ArrayView1};
use rayon::prelude::*;

use crate::{
    Result,
    job::Watch,
    nn::{
        matrix::{self, product, view, view_mut},
        vectors::{longest, longest_square},
    },
};

/// A frame in which at most this many shapes move is left as it is.
pub(in crate::deform) const MOVING: usize = 20;
/// For each shape the error is first measured in this many regions, at the vertex that the shape
/// moves farthest. A missing shape shows there first.
const FARTHEST: usize = 8;
/// Vertices that are measured before a look ends at the first error.
const VERTICES_PER_LOOK: usize = 64;
/// Frames with an error are done again this many times, the last time with all vertices.
const LOOKS: usize = 4;
/// Frames whose error is measured together.
const FRAMES_PER_TASK: usize = 16;
/// The vertices of a mesh are divided into this many regions, in the order of their numbers.
const REGIONS: usize = 256;

/// Sets those weights `[T, K]` of each frame to zero that matter least, until [`MOVING`] shapes move.
/// No vertex of `flat` `[T, 3V]` gets further from its place than `max_error`, or than the largest
/// error of its frame was before. `shapes`: `[3V, K]`; `error`: the largest before. Returns the
/// largest error.
///
/// # Errors
/// `Cancelled`.
pub(in crate::deform) fn sparsify(
    flat: &Array2<f32>,
    weights: &mut Array2<f32>,
    shapes: &Array2<f32>,
    (max_error, error): (f32, f32),
    watch: &Watch<'_>,
) -> Result<f32> {
    let mut bounds = vec![max_error; weights.nrows()];
    if error > max_error {
        let before = farthest_of_frames(flat, weights, shapes, watch)?.into_iter();
        bounds = before.map(|(error, _)| error.max(max_error)).collect();
    }
    let full = weights.clone();
    let mut frames: Vec<usize> = (0..weights.nrows()).collect();
    let mut rows = Rows::farthest(shapes);
    for look in 0..=LOOKS {
        rows.sparsify(flat, weights, &frames, &bounds, watch)?;
        let farthest = farthest_of_frames(flat, weights, shapes, watch)?;
        frames.retain(|&t| farthest[t].0 > bounds[t]);
        if frames.is_empty() {
            return Ok(farthest.iter().fold(0.0, |error, one| one.0.max(error)));
        }
        // A vertex that was not measured moved too far: these frames are done again with it.
        for &t in &frames {
            weights.row_mut(t).assign(&full.row(t));
        }
        let mut vertices = rows.vertices;
        if look + 1 < LOOKS {
            vertices.extend(frames.iter().map(|&t| farthest[t].1))
        } else {
            vertices = (0..shapes.nrows() / 3).collect()
        }
        vertices.sort_unstable();
        vertices.dedup();
        rows = Rows::of(vertices, shapes);
    }
    let left = farthest_of_frames(flat, weights, shapes, watch)?.into_iter();
    Ok(left.fold(0.0, |error, one| one.0.max(error)))
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
        watch: &Watch<'_>,
    ) -> Result<()> {
        let thinned: Vec<Vec<f32>> = frames
            .par_iter()
            .map(|&t| {
                let mut row = weights.row(t).to_vec();
                if watch.is_wanted() {
                    self.thin_frame(flat.row(t), &mut row, bounds[t]);
                }
                row
            })
            .collect();
        for (&t, row) in frames.iter().zip(thinned) {
            weights.row_mut(t).assign(&ArrayView1::from(&row));
        }
        watch.check()
    }

    fn thin_frame(&self, frame: ArrayView1<'_, f32>, weights: &mut [f32], bound: f32) {
        let mut left = self.left(frame, weights);
        let mut moving = weights.iter().filter(|w| **w != 0.0).count();
        let reach = |k: &usize| weights[*k].abs() * self.sizes[*k];
        let mut order: Vec<usize> = (0..weights.len()).collect();
        order.sort_by(|a, b| reach(a).total_cmp(&reach(b)));
        let mut without = vec![0.0; left.len()];
        for k in order {
            if moving <= MOVING {
                break;
            }
            if weights[k] == 0.0 {
                continue;
            }
            if self.leave_out(&left, k, weights[k], bound, &mut without) {
                (left, without) = (without, left);
                weights[k] = 0.0;
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

    /// Writes what is left of a frame without the weighted shape `k` into `out` `[3n]`. Returns
    /// whether all vertices stay within `bound`; if not, `out` is not complete.
    fn leave_out(&self, left: &[f32], k: usize, weight: f32, bound: f32, out: &mut [f32]) -> bool {
        let shape = self.shapes.row(k);
        let shape = shape
            .to_slice()
            .expect("row-major")
            .chunks(3 * VERTICES_PER_LOOK);
        let left = left.chunks(3 * VERTICES_PER_LOOK);
        let mut parts = out.chunks_mut(3 * VERTICES_PER_LOOK).zip(left.zip(shape));
        parts.all(|(out, (left, shape))| {
            for (out, (left, shape)) in out.iter_mut().zip(left.iter().zip(shape)) {
                *out = left + weight * shape;
            }
            longest_square(out) <= bound * bound
        })
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

/// For each frame the vertex that is farthest from its place: its distance, mesh units, and number.
fn farthest_of_frames(
    flat: &Array2<f32>,
    weights: &Array2<f32>,
    shapes: &Array2<f32>,
    watch: &Watch<'_>,
) -> Result<Vec<(f32, usize)>> {
    let (frames, coordinates) = flat.dim();
    let starts: Vec<usize> = (0..frames).step_by(FRAMES_PER_TASK).collect();
    let farthest_in = |&first: &usize| {
        if !watch.is_wanted() {
            return Vec::new();
        }
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
        let farthest = rows.map(longest);
        let farthest = farthest.map(|(square, vertex)| (square.sqrt(), vertex));
        farthest.collect::<Vec<_>>()
    };
    let farthest = starts.par_iter().map(farthest_in).flatten_iter().collect();
    watch.check().map(|()| farthest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::SILENT;

    fn thinned(
        flat: &Array2<f32>,
        weights: &mut Array2<f32>,
        shapes: &Array2<f32>,
        max_error: f32,
    ) -> f32 {
        let watch = Watch::new(SILENT, "test", 0.0);
        sparsify(flat, weights, shapes, (max_error, 0.0), &watch).unwrap()
    }

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
            let error = thinned(&flat, &mut weights, &shapes, 0.1);
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
        let error = thinned(&flat, &mut weights, &shapes, 0.05);
        let left = &flat - &weights.dot(&shapes.t());
        assert!(longest_square(matrix::values(&left)).sqrt() <= 0.05 + 1e-6);
        assert!(error <= 0.05);
    }

    #[test]
    fn shapes_that_all_matter_stay() {
        let (flat, weights, shapes) = motion(10, 30);
        let mut sparse = weights.clone();
        thinned(&flat, &mut sparse, &shapes, 0.0);
        assert_eq!(sparse, weights);
    }
}
