//! Fixed weights over the landmarks: the deformer whose frames cost one small matrix product.

use faer::MatRef;
use ndarray::{Array2, Array3, ArrayView3};
use rayon::prelude::*;

use super::Deformer;
use crate::{
    Error, Result,
    motion::LANDMARKS,
    nn::matrix,
    progress::{ProgressFn, report},
};

/// Frames between two looks at the progress callback.
const FRAMES_PER_REPORT: usize = 256;
/// Vertices of one piece of parallel work.
const VERTICES_PER_TASK: usize = 1024;

/// `ΔV = mix · ΔL + cross · motion · ΔL`, linear in the landmarks.
///
/// `mix` moves a vertex along with landmarks; `cross` lets the axes of the motion mix, through `R`
/// shared combinations of all landmark coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkWeights {
    /// `[V, 68]`, unitless.
    pub mix: Array2<f32>,
    /// `[V, 3 R]`, axis by axis.
    pub cross: Array2<f32>,
    /// `[R, 204]`, over landmark coordinates x0, y0, z0, x1, …
    pub motion: Array2<f32>,
}

impl LandmarkWeights {
    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.mix.nrows()
    }

    fn rank(&self) -> usize {
        self.motion.nrows()
    }

    /// Displacements of `frames` frames into `out` `[frames, V, 3]`.
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
        let blocks: Vec<usize> = (0..vertices).step_by(VERTICES_PER_TASK).collect();
        let pieces: Vec<Vec<f32>> = blocks
            .par_iter()
            .map(|&first| self.spread_block(first, &by_axis, &shared, frames))
            .collect();
        out.par_chunks_mut(3 * vertices)
            .enumerate()
            .for_each(|(t, frame)| copy_frame(t, frames, &pieces, frame));
    }

    /// Displacements `[3, frames, block]` of the block of vertices from `first` on.
    fn spread_block(
        &self,
        first: usize,
        by_axis: &[f32],
        shared: &[f32],
        frames: usize,
    ) -> Vec<f32> {
        let count = VERTICES_PER_TASK.min(self.vertices() - first);
        let rank = self.rank();
        let mix = matrix::view(&self.mix).subrows(first, count).transpose();
        let cross = matrix::view(&self.cross).subrows(first, count);
        let mut piece = vec![0.0; 3 * frames * count];
        for (axis, out) in piece.chunks_mut((frames * count).max(1)).enumerate() {
            let along = &by_axis[axis * frames * LANDMARKS..(axis + 1) * frames * LANDMARKS];
            let mut out = matrix::view_mut(out, count);
            matrix::product(out.as_mut(), matrix::rows_of(along, LANDMARKS), mix);
            if rank > 0 {
                let cross = cross.subcols(axis * rank, rank).transpose();
                matrix::product_add(out, matrix::rows_of(shared, rank), cross);
            }
        }
        piece
    }
}

/// Gathers frame `t` from the pieces of all blocks and puts the three axes side by side.
fn copy_frame(t: usize, frames: usize, pieces: &[Vec<f32>], frame: &mut [f32]) {
    let mut targets = frame.chunks_exact_mut(3);
    for piece in pieces {
        let count = piece.len() / (3 * frames);
        let axis = |a: usize| &piece[(a * frames + t) * count..(a * frames + t + 1) * count];
        let (x, y, z) = (axis(0), axis(1), axis(2));
        for (v, target) in targets.by_ref().take(count).enumerate() {
            target.copy_from_slice(&[x[v], y[v], z[v]]);
        }
    }
}

impl Deformer for LandmarkWeights {
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
    use crate::progress::SILENT;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn random(rng: &mut ChaCha8Rng, rows: usize, columns: usize) -> Array2<f32> {
        Array2::from_shape_fn((rows, columns), |_| rng.random_range(-1.0..1.0))
    }

    /// The formula, one number at a time.
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
    fn wrong_landmark_count_is_an_error_and_cancelling_stops() {
        let weights = LandmarkWeights {
            mix: Array2::zeros((2, LANDMARKS)),
            cross: Array2::zeros((2, 0)),
            motion: Array2::zeros((0, 204)),
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
