//! The frames from which a scene makes its shapes or solves its weights. They wait in memory, or in
//! a file if they are many.

use std::{ops::Range, path::Path};

use ndarray::{Array2, Array3, ArrayView3, s};

use super::rows::Rows;
use crate::{
    Result,
    deform::{
        VertexClip,
        compression::{VertexBasis, compress},
        long_compression::{LongClip, compress_long},
    },
    job::ProgressFn,
    spread::ClipStart,
};

/// The most frames that wait in memory: ten minutes at 25 per second.
pub(super) const MAX_IN_MEMORY: usize = 15_000;
/// Frames of a long clip whose weights are solved together: at most so many, and as many as fill so
/// many bytes, but not fewer than the least.
pub(super) const SOLVED: usize = 6_000;
const SOLVED_BYTES: usize = 32 << 20;
const LEAST_SOLVED: usize = 1_000;
/// Frames before and after them that are solved too and dropped. Weights depend on their neighbours
/// in time, but hardly on those of ten seconds away.
const BESIDE: usize = 250;

/// The displacements of a clip, mesh units.
pub(super) struct Moved {
    frames: usize,
    vertices: usize,
    fps: f64,
    place: Place,
}

enum Place {
    Memory(Vec<f32>),
    File(Rows),
}

impl Moved {
    /// No frames yet. `path`: the final file. If many frames are announced, they wait beside it.
    ///
    /// # Errors
    /// `Io` if they cannot.
    pub(super) fn begin(path: &Path, start: &ClipStart<'_>) -> Result<Moved> {
        let place = if start.frames <= MAX_IN_MEMORY {
            Place::Memory(Vec::new())
        } else {
            Place::File(Rows::beside(path)?)
        };
        Ok(Moved {
            frames: start.frames,
            vertices: start.mesh.positions.len(),
            fps: start.fps,
            place,
        })
    }

    /// Adds the next frames, `[n, V, 3]`.
    ///
    /// # Errors
    /// `Io` of the file in which they wait.
    pub(super) fn add(&mut self, block: ArrayView3<'_, f32>) -> Result<()> {
        match &mut self.place {
            Place::Memory(values) => values.extend(block.iter()),
            Place::File(rows) => rows.add(block.into_dyn())?,
        }
        Ok(())
    }

    pub(super) fn fps(&self) -> f64 {
        self.fps
    }

    /// The clip as a few shapes that keep every vertex within `max_error` of its place, and their
    /// weights.
    ///
    /// # Errors
    /// Those of [`compress`] and of the file in which the frames wait.
    pub(super) fn into_basis(
        self,
        max_error: f32,
        progress: ProgressFn<'_>,
    ) -> Result<VertexBasis> {
        let (frames, vertices, fps) = (self.frames, self.vertices, self.fps);
        match self.place {
            Place::Memory(values) => {
                let displacements = cube(values, vertices);
                let clip = VertexClip { displacements, fps };
                compress(&clip, max_error, frames.max(1), progress)
            }
            Place::File(mut rows) => {
                let mut read = |range| Ok(cube(rows.read(range)?, vertices));
                let mut clip = LongClip {
                    frames,
                    vertices,
                    fps,
                    read: &mut read,
                };
                compress_long(&mut clip, max_error, progress)
            }
        }
    }

    /// Weights `[T, columns]` that `solve` finds for stretches of the clip. It gets the numbers of
    /// the frames and their displacements, and returns their weights.
    ///
    /// # Errors
    /// Those of `solve` and of the file in which the frames wait.
    pub(super) fn solve(
        &mut self,
        columns: usize,
        mut solve: impl FnMut(Range<usize>, ArrayView3<'_, f32>) -> Result<Array2<f32>>,
    ) -> Result<Array2<f32>> {
        let (frames, vertices) = (self.frames, self.vertices);
        let rows = match &mut self.place {
            Place::Memory(values) => {
                let all = ArrayView3::from_shape((frames, vertices, 3), values);
                return solve(0..frames, all.expect("as many numbers as were announced"));
            }
            Place::File(rows) => rows,
        };
        let count = SOLVED_BYTES / (12 * vertices.max(1));
        let count = count.clamp(LEAST_SOLVED, SOLVED);
        let mut weights = Array2::zeros((frames, columns));
        for start in (0..frames).step_by(count) {
            let end = (start + count).min(frames);
            let range = start.saturating_sub(BESIDE)..(end + BESIDE).min(frames);
            let moved = cube(rows.read(range.clone())?, vertices);
            let solved = solve(range.clone(), moved.view())?;
            let kept = solved.slice(s![start - range.start..end - range.start, ..]);
            weights.slice_mut(s![start..end, ..]).assign(&kept);
        }
        Ok(weights)
    }
}

/// `[n, V, 3]` of row-major values.
fn cube(values: Vec<f32>, vertices: usize) -> Array3<f32> {
    let frames = values.len() / (3 * vertices.max(1));
    Array3::from_shape_vec((frames, vertices, 3), values).expect("whole frames")
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3, Axis};

    use super::*;
    use crate::mesh::{Mesh, canonical_landmarks};

    #[test]
    fn stretches_of_a_long_clip_join_to_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = Mesh {
            positions: vec![[0.0; 3]; 2],
            ..Mesh::default()
        };
        let frames = MAX_IN_MEMORY + 7;
        let start = ClipStart {
            mesh: &mesh,
            landmarks: canonical_landmarks(),
            frames,
            fps: 25.0,
        };
        let mut moved = Moved::begin(&folder.path().join("a.vrma"), &start).unwrap();
        let all = Array3::from_shape_fn((frames, 2, 3), |(t, v, i)| (6 * t + 3 * v + i) as f32);
        for block in all.axis_chunks_iter(Axis(0), 4_000) {
            moved.add(block).unwrap();
        }
        let mut longest = 0;
        let solve = |range: Range<usize>, part: ArrayView3<'_, f32>| {
            longest = longest.max(range.len());
            assert_eq!(part, all.slice(s![range.clone(), .., ..]));
            Ok(Array2::from_shape_fn((range.len(), 2), |(t, k)| {
                ((range.start + t) * (k + 1)) as f32
            }))
        };
        let weights = moved.solve(2, solve).unwrap();
        assert!(longest <= SOLVED + 2 * BESIDE);
        for (t, row) in weights.outer_iter().enumerate() {
            assert_eq!(row.to_vec(), [t as f32, 2.0 * t as f32]);
        }
    }
}
