//! The deformer with fixed weights over the landmarks. A frame costs one small matrix product.

use faer::MatRef;
use ndarray::{Array2, Array3, ArrayView3, Axis, Slice, s};
use rayon::prelude::*;

use crate::{
    Error, Result,
    face::{Deformer, FewVertices, ShapeProducts, proxy::Prolongation},
    job::{ProgressFn, SILENT, report},
    mesh::ibug::LANDMARKS,
    nn::matrix,
};

/// Frames between two calls of the progress callback.
const FRAMES_PER_REPORT: usize = 64;
/// Vertices in one parallel task.
const VERTICES_PER_TASK: usize = 512;
/// Vertices in one step of a sum over all vertices.
const VERTICES_PER_PRODUCT: usize = 4096;

/// `ΔV = mix · ΔL + cross · motion · ΔL`, linear in the landmarks.
///
/// `mix` moves a vertex along with landmarks. `cross` lets the axes of the motion mix, through `R`
/// shared combinations of all landmark coordinates. A large mesh has weights for `N` rows only, and
/// each vertex blends the motion of a few rows. Weights for each of two million vertices would take
/// a gigabyte.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkWeights {
    /// `[N, 68]`, unitless. `N` is `V` where vertices follow no rows.
    pub mix: Array2<f32>,
    /// `[N, 3 R]`, axis by axis.
    pub cross: Array2<f32>,
    /// `[R, 204]`, over landmark coordinates x0, y0, z0, x1, …
    pub motion: Array2<f32>,
    /// `[V, N]`, sparse: the rows that each vertex follows.
    pub follows: Option<Prolongation>,
}

impl LandmarkWeights {
    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        let follows = self.follows.as_ref();
        follows.map_or(self.mix.nrows(), Prolongation::rows)
    }

    fn rank(&self) -> usize {
        self.motion.nrows()
    }

    /// The same weights with a row for every vertex.
    pub fn with_row_per_vertex(&self) -> LandmarkWeights {
        let all: Vec<u32> = (0..self.vertices() as u32).collect();
        self.rows_of(&all)
    }

    /// Weights of these vertices, one row for each.
    fn rows_of(&self, vertices: &[u32]) -> LandmarkWeights {
        let select = |of: &Array2<f32>| {
            let Some(follows) = &self.follows else {
                let rows: Vec<usize> = vertices.iter().map(|&v| v as usize).collect();
                return of.select(Axis(0), &rows);
            };
            let (rows, columns) = (matrix::values(of), of.ncols());
            let mut out = Array2::zeros((vertices.len(), columns));
            let values = out.as_slice_mut().expect("a new array is row-major");
            let each = values.par_chunks_mut(columns.max(1)).zip(vertices);
            each.for_each(|(row, &v)| follows.take_up(v as usize, rows, columns, row));
            out
        };
        LandmarkWeights {
            mix: select(&self.mix),
            cross: select(&self.cross),
            motion: self.motion.clone(),
            follows: None,
        }
    }

    /// Writes the displacements of all frames to `out` `[frames, V, 3]`.
    fn spread(&self, landmarks: &[f32], out: &mut [f32]) {
        let (vertices, rank, coordinates) = (self.vertices(), self.rank(), 3 * LANDMARKS);
        let frames = landmarks.len() / coordinates;
        let moved = MatRef::from_row_major_slice(landmarks, frames, coordinates);
        let mut shared = vec![0.0f32; frames * rank];
        if rank > 0 {
            let motion = matrix::view(&self.motion).transpose();
            matrix::product(matrix::view_mut(&mut shared, rank), moved, motion);
        }
        let by_axis: Vec<f32> = (0..3)
            .flat_map(|axis| landmarks.iter().skip(axis).step_by(3).copied())
            .collect();
        match &self.follows {
            None => by_blocks(out, vertices, frames, |first, tile| {
                self.tile(first, &by_axis, &shared, tile);
            }),
            Some(follows) => {
                let columns = 3 * frames;
                let mut rows = vec![0.0; self.mix.nrows() * columns];
                let tiles = rows.par_chunks_mut((VERTICES_PER_TASK * columns).max(1));
                tiles.enumerate().for_each(|(index, tile)| {
                    self.tile(index * VERTICES_PER_TASK, &by_axis, &shared, tile);
                });
                by_blocks(out, vertices, frames, |first, tile| {
                    follows.take_up(first, &rows, columns, tile);
                });
            }
        }
    }

    /// Writes the displacements `[block, 3 frames]`, axis by axis, of the rows from `first` on.
    fn tile(&self, first: usize, by_axis: &[f32], shared: &[f32], tile: &mut [f32]) {
        let count = VERTICES_PER_TASK.min(self.mix.nrows() - first);
        let (rank, columns) = (self.rank(), by_axis.len() / LANDMARKS);
        let frames = columns / 3;
        let mix = matrix::view(&self.mix).subrows(first, count);
        let mut out = matrix::view_mut(&mut tile[..count * columns], columns);
        let along = matrix::rows_of(by_axis, LANDMARKS).transpose();
        matrix::product(out.as_mut(), mix, along);
        if rank > 0 {
            let cross = matrix::view(&self.cross).subrows(first, count);
            let shared = matrix::rows_of(shared, rank).transpose();
            for axis in 0..3 {
                let out = out.as_mut().subcols_mut(axis * frames, frames);
                matrix::product_add(out, cross.subcols(axis * rank, rank), shared);
            }
        }
    }
}

/// Products of frames with shapes. They are linear in the landmarks, as the frames are.
struct LandmarkProducts {
    /// `[204, S]`, over landmark coordinates x0, y0, z0, x1, …
    products: Array2<f64>,
    /// Weights of the vertices whose displacements are returned too.
    shown: LandmarkWeights,
}

impl LandmarkProducts {
    /// Computes the products in one pass over the vertices, a block at a time.
    fn new(
        weights: &LandmarkWeights,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> LandmarkProducts {
        let (count, vertices, _) = shapes.dim();
        let rank = weights.rank();
        let mut products = Array2::<f64>::zeros((3 * LANDMARKS, count));
        let mut crossed = Array2::<f64>::zeros((rank, count));
        for first in (0..vertices).step_by(VERTICES_PER_PRODUCT) {
            let last = (first + VERTICES_PER_PRODUCT).min(vertices);
            let rows = weights.rows_of(&Vec::from_iter(first as u32..last as u32));
            for axis in 0..3 {
                let of_axis = shapes.slice(s![.., first..last, axis]);
                // `[68, S]`
                let along: Array2<f32> = rows.mix.t().dot(&of_axis.t());
                let mut target =
                    products.slice_axis_mut(Axis(0), Slice::new(axis as isize, None, 3));
                target += &along.mapv(f64::from);
                let cross = rows.cross.slice(s![.., axis * rank..(axis + 1) * rank]);
                let across: Array2<f32> = cross.t().dot(&of_axis.t());
                crossed += &across.mapv(f64::from);
            }
        }
        products += &weights.motion.mapv(f64::from).t().dot(&crossed);
        LandmarkProducts {
            products,
            shown: weights.rows_of(shown),
        }
    }
}

impl ShapeProducts for LandmarkProducts {
    fn of(&self, landmarks: ArrayView3<'_, f32>) -> Result<(Array2<f64>, Array3<f32>)> {
        let moved = self.shown.deform(landmarks, SILENT)?;
        let frames = landmarks.dim().0;
        let flat = landmarks.mapv(f64::from);
        let flat = flat.to_shape((frames, 3 * LANDMARKS));
        Ok((flat.expect("row-major array").dot(&self.products), moved))
    }
}

/// Fills `out` `[frames, V, 3]` from tiles `[block, 3 frames]` of a few vertices each, axis by axis, in parallel.
fn by_blocks(
    out: &mut [f32],
    vertices: usize,
    frames: usize,
    fill: impl Fn(usize, &mut [f32]) + Sync,
) {
    let mut blocks: Vec<Vec<&mut [f32]>> = Vec::new();
    blocks.resize_with(vertices.div_ceil(VERTICES_PER_TASK), Vec::new);
    for frame in out.chunks_mut((3 * vertices).max(1)) {
        let pieces = frame.chunks_mut(3 * VERTICES_PER_TASK);
        blocks.iter_mut().zip(pieces).for_each(|(b, p)| b.push(p));
    }
    blocks.into_par_iter().enumerate().for_each_init(
        || vec![0.0; 3 * frames * VERTICES_PER_TASK],
        |tile, (index, mut out)| {
            let first = index * VERTICES_PER_TASK;
            let count = VERTICES_PER_TASK.min(vertices - first);
            let tile = &mut tile[..3 * frames * count];
            fill(first, tile);
            write_out(tile, &mut out);
        },
    );
}

/// Transposes `[block, 3 frames]` into one `[block, 3]` for each frame while the tile is in the
/// cache.
fn write_out(tile: &[f32], out: &mut [&mut [f32]]) {
    let frames = out.len();
    for (t, frame) in out.iter_mut().enumerate() {
        let (targets, _) = frame.as_chunks_mut::<3>();
        for (target, row) in targets.iter_mut().zip(tile.chunks_exact(3 * frames)) {
            *target = [row[t], row[frames + t], row[2 * frames + t]];
        }
    }
}

impl Deformer for LandmarkWeights {
    fn of_vertices(&self, vertices: &[u32]) -> Option<FewVertices> {
        Some(FewVertices {
            deformer: Box::new(self.rows_of(vertices)),
            vertices: vertices.to_vec(),
        })
    }

    fn products_with(
        &self,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> Option<Box<dyn ShapeProducts>> {
        Some(Box::new(LandmarkProducts::new(self, shapes, shown)))
    }

    fn deform(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let (frames, count, axes) = landmarks.dim();
        if (count, axes) != (LANDMARKS, 3) {
            return Err(Error::ShapeMismatch {
                what: "landmark displacements",
                expected: format!("[T, {LANDMARKS}, 3]"),
                got: format!("[{frames}, {count}, {axes}]"),
            });
        }
        let landmarks = landmarks.as_standard_layout();
        let values = landmarks.as_slice().expect("standard layout");
        let mut out = Array3::zeros((frames, self.vertices(), 3));
        let size = 3 * self.vertices();
        let target = out.as_slice_mut().expect("a new array is row-major");
        for first in (0..frames).step_by(FRAMES_PER_REPORT) {
            report(progress, "deform", first as f32 / frames as f32)?;
            let last = (first + FRAMES_PER_REPORT).min(frames);
            let coordinates = 3 * LANDMARKS;
            self.spread(
                &values[first * coordinates..last * coordinates],
                &mut target[first * size..last * size],
            );
        }
        report(progress, "deform", 1.0)?;
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn random(rng: &mut ChaCha8Rng, rows: usize, columns: usize) -> Array2<f32> {
        Array2::from_shape_fn((rows, columns), |_| rng.random_range(-1.0..1.0))
    }

    /// Evaluates the formula one number at a time.
    fn slow(weights: &LandmarkWeights, landmarks: &Array3<f32>) -> Array3<f32> {
        let rank = weights.rank();
        Array3::from_shape_fn((landmarks.dim().0, weights.vertices(), 3), |(t, v, x)| {
            let mixed: f32 = (0..LANDMARKS)
                .map(|n| weights.mix[[v, n]] * landmarks[[t, n, x]])
                .sum();
            let crossed: f32 = (0..rank)
                .map(|r| {
                    let shared: f32 = (0..204)
                        .map(|c| weights.motion[[r, c]] * landmarks[[t, c / 3, c % 3]])
                        .sum();
                    weights.cross[[v, x * rank + r]] * shared
                })
                .sum();
            mixed + crossed
        })
    }

    #[test]
    fn blocks_and_frames_add_up_to_the_plain_formula() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for (vertices, frames, rank) in [(7, 1, 2), (1500, 5, 3), (3, 300, 0)] {
            let weights = LandmarkWeights {
                mix: random(&mut rng, vertices, LANDMARKS),
                cross: random(&mut rng, vertices, 3 * rank),
                motion: random(&mut rng, rank, 204),
                follows: None,
            };
            let landmarks = random(&mut rng, frames, 204)
                .into_shape_with_order((frames, LANDMARKS, 3))
                .unwrap();
            let fast = weights.deform(landmarks.view(), SILENT).unwrap();
            let slow = slow(&weights, &landmarks);
            assert_eq!(fast.dim(), slow.dim());
            for (a, b) in fast.iter().zip(&slow) {
                assert!((a - b).abs() < 2e-4, "expected {b}, got {a}");
            }
        }
    }

    #[test]
    fn vertices_that_follow_rows_move_as_with_weights_of_their_own() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        for (vertices, frames, rank) in [(2_000, 70, 3), (5, 1, 0)] {
            let rows = 40;
            let follows = Prolongation::from_rows((0..vertices).map(|_| {
                let entry = |rng: &mut ChaCha8Rng| (rng.random_range(0..rows), rng.random::<f32>());
                (0..rng.random_range(0..5))
                    .map(|_| entry(&mut rng))
                    .collect()
            }));
            let sparse = LandmarkWeights {
                mix: random(&mut rng, rows as usize, LANDMARKS),
                cross: random(&mut rng, rows as usize, 3 * rank),
                motion: random(&mut rng, rank, 204),
                follows: Some(follows),
            };
            assert_eq!(sparse.vertices(), vertices);
            let all: Vec<u32> = (0..vertices as u32).collect();
            let dense = sparse.rows_of(&all);
            assert_eq!((dense.vertices(), &dense.follows), (vertices, &None));
            let landmarks = random(&mut rng, frames, 204)
                .into_shape_with_order((frames, LANDMARKS, 3))
                .unwrap();
            let expected = dense.deform(landmarks.view(), SILENT).unwrap();
            let got = sparse.deform(landmarks.view(), SILENT).unwrap();
            assert_eq!(got.dim(), expected.dim());
            for (a, b) in got.iter().zip(&expected) {
                assert!((a - b).abs() < 1e-3, "expected {b}, got {a}");
            }
        }
    }

    #[test]
    fn wrong_landmark_count_is_an_error_and_cancelling_stops() {
        let weights = LandmarkWeights {
            mix: Array2::zeros((2, LANDMARKS)),
            cross: Array2::zeros((2, 0)),
            motion: Array2::zeros((0, 204)),
            follows: None,
        };
        let wrong = weights.deform(Array3::zeros((2, 67, 3)).view(), SILENT);
        let message = wrong.unwrap_err().to_string();
        assert_eq!(
            message,
            "landmark displacements: expected [T, 68, 3], got [2, 67, 3]"
        );
        let cancelled = weights.deform(Array3::zeros((2, 68, 3)).view(), &|_| false);
        assert!(matches!(cancelled, Err(Error::Cancelled)));
    }
}
