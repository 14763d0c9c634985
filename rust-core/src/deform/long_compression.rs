//! Compresses a clip whose frames do not fit into memory together.
//!
//! Speech repeats itself, so the shapes of some frames move all the others too. This looks for
//! shapes in frames that are evenly spread over the clip, and fits them to every frame. Then it adds
//! the frames that are too far from their place to the search, until there are none.

use std::ops::Range;

use ndarray::{Array2, Array3, Axis, ShapeBuilder, s};

use super::{
    VertexClip,
    compression::{MOVING, VertexBasis, compress, sparsify},
    projection::Projection,
};
use crate::{
    Result,
    job::{ProgressFn, Watch, report},
    nn::vectors::longest_square,
};

/// Searches before the shapes are taken as they are. Two suffice for speech.
const ROUNDS: usize = 5;
/// The search keeps its frames within this share of the error, because other frames lie farther.
const MARGIN: f32 = 0.7;
/// Frames with an error that join the search must be this far apart. Nearer ones resemble each other.
const APART: usize = 12;
/// Bytes of the frames that are searched together, and of those that are fitted together.
const BYTES: usize = 24 << 20;
/// The least and the most frames that are searched at first.
const SEARCHED: [usize; 2] = [500, 3_000];
/// The most frames that are fitted together.
const FITTED: usize = 1_024;

/// A clip that lies in a file.
pub struct LongClip<'a> {
    /// Number `T` of frames.
    pub frames: usize,
    /// Number `V` of vertices.
    pub vertices: usize,
    /// Frames per second.
    pub fps: f64,
    /// Reads the displacements `[n, V, 3]` of `n` frames, mesh units.
    pub read: &'a mut dyn FnMut(Range<usize>) -> Result<Array3<f32>>,
}

/// Does the same as [`super::compression::compress`] with memory for some frames and for all
/// weights, which lie column by column.
///
/// # Errors
/// Those of [`super::compression::compress`] and of the clip.
pub fn compress_long(
    clip: &mut LongClip<'_>,
    max_error: f32,
    progress: ProgressFn<'_>,
) -> Result<VertexBasis> {
    let [least, most] = SEARCHED;
    let searched = clip.frames_of(BYTES).clamp(least, most);
    let step = clip.frames.div_ceil(searched).max(1);
    let mut chosen: Vec<usize> = (0..clip.frames).step_by(step).collect();
    let mut round = 1;
    loop {
        let part = clip.select(&chosen)?;
        let mut basis = compress(&part, MARGIN * max_error, chosen.len(), progress)?;
        let errors = clip.fit(&mut basis, progress)?;
        basis.max_error = errors.iter().copied().fold(0.0, f32::max);
        if basis.max_error <= max_error || round == ROUNDS {
            clip.sparsify(&mut basis, max_error, progress)?;
            normalise(&mut basis);
            return Ok(basis);
        }
        chosen.extend(farthest(&errors, max_error, searched / 4));
        chosen.sort_unstable();
        chosen.dedup();
        round += 1;
    }
}

impl LongClip<'_> {
    /// How many frames fill so many bytes.
    fn frames_of(&self, bytes: usize) -> usize {
        bytes / (12 * self.vertices.max(1))
    }

    /// Ranges of frames that are read together.
    fn blocks(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let (frames, count) = (self.frames, self.frames_of(BYTES).clamp(1, FITTED));
        let starts = (0..frames).step_by(count);
        starts.map(move |start| start..(start + count).min(frames))
    }

    /// The frames of these numbers, which rise.
    fn select(&mut self, numbers: &[usize]) -> Result<VertexClip> {
        let mut displacements = Array3::zeros((numbers.len(), self.vertices, 3));
        for (mut to, number) in displacements.outer_iter_mut().zip(numbers) {
            to.assign(&(self.read)(*number..number + 1)?.index_axis(Axis(0), 0));
        }
        Ok(VertexClip {
            displacements,
            fps: self.fps,
        })
    }

    /// Replaces the weights of the basis by those that bring its shapes nearest to every frame.
    /// Returns the largest distance of a vertex from its place in each frame, `[T]`.
    fn fit(&mut self, basis: &mut VertexBasis, progress: ProgressFn<'_>) -> Result<Vec<f32>> {
        let all: Vec<u32> = (0..self.vertices as u32).collect();
        let projection = Projection::new(basis, &all)?;
        // Column by column, so that more columns may be added without a copy.
        let mut weights = Array2::zeros((self.frames, projection.shapes()).f());
        let mut errors = Vec::with_capacity(self.frames);
        for range in self.blocks() {
            report(
                progress,
                "compress",
                range.start as f32 / self.frames as f32,
            )?;
            let mut left = (self.read)(range.clone())?;
            let part = VertexBasis {
                weights: projection.weights(&left),
                shapes: std::mem::take(&mut basis.shapes),
                ..*basis
            };
            left -= &part.displacements();
            let lengths = left.outer_iter().map(|frame| {
                let frame = frame.to_slice().expect("row-major");
                longest_square(frame).sqrt()
            });
            errors.extend(lengths);
            weights.slice_mut(s![range, ..]).assign(&part.weights);
            basis.shapes = part.shapes;
        }
        basis.weights = weights;
        Ok(errors)
    }

    /// Sets weights to zero where every vertex stays within `max_error` of its place without them.
    fn sparsify(
        &mut self,
        basis: &mut VertexBasis,
        max_error: f32,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let (count, vertices, _) = basis.shapes.dim();
        if count <= MOVING {
            return Ok(());
        }
        let shapes = Array2::from_shape_fn((3 * vertices, count), |(c, k)| {
            basis.shapes[[k, c / 3, c % 3]]
        });
        let mut error = 0.0f32;
        for range in self.blocks() {
            let watch = Watch::new(
                progress,
                "compress",
                range.start as f32 / self.frames as f32,
            );
            let block = (self.read)(range.clone())?;
            let flat = block.into_shape_with_order((range.len(), 3 * vertices));
            let flat = flat.expect("row-major");
            let weights = basis.weights.slice(s![range.clone(), ..]);
            let mut weights = weights.as_standard_layout().into_owned();
            let bound = (max_error, basis.max_error);
            error = error.max(sparsify(&flat, &mut weights, &shapes, bound, &watch)?);
            basis.weights.slice_mut(s![range, ..]).assign(&weights);
        }
        basis.max_error = error;
        Ok(())
    }
}

/// The frames that are farthest from their place, at most `most`.
fn farthest(errors: &[f32], max_error: f32, most: usize) -> Vec<usize> {
    let mut ranked: Vec<usize> = (0..errors.len())
        .filter(|t| errors[*t] > max_error)
        .collect();
    ranked.sort_by(|a, b| errors[*b].total_cmp(&errors[*a]));
    let mut taken = vec![false; errors.len() / APART + 1];
    ranked.retain(|t| !std::mem::replace(&mut taken[t / APART], true));
    ranked.truncate(most);
    ranked
}

/// Scales the shapes so that the weights of each reach 1 or −1.
fn normalise(basis: &mut VertexBasis) {
    let columns = basis.weights.axis_iter_mut(Axis(1));
    for (mut weights, mut shape) in columns.zip(basis.shapes.outer_iter_mut()) {
        let largest = weights.iter().fold(0.0f32, |most, w| most.max(w.abs()));
        if largest > 0.0 {
            weights.mapv_inplace(|w| (w / largest).clamp(-1.0, 1.0));
            shape.mapv_inplace(|x| x * largest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::SILENT;

    /// Forty vertices that move in thirty ways, one of which fills few frames of the middle.
    fn frames(range: Range<usize>) -> Array3<f32> {
        Array3::from_shape_fn((range.len(), 40, 3), |(t, v, x)| {
            let t = (range.start + t) as f32;
            let place = (3 * v + x) as f32;
            let usual: f32 = (1..30)
                .map(|k| k as f32)
                .map(|k| (0.013 * k * t).sin() * (0.37 * k * place).cos() / k)
                .sum();
            let rare = if (9_007.0..9_012.0).contains(&t) {
                (0.9 * place).sin()
            } else {
                0.0
            };
            usual + rare
        })
    }

    #[test]
    fn every_frame_of_a_long_clip_is_within_its_error() {
        let mut largest_read = 0;
        let mut read = |range: Range<usize>| {
            largest_read = largest_read.max(range.len());
            Ok(frames(range))
        };
        let mut clip = LongClip {
            frames: 20_000,
            vertices: 40,
            fps: 25.0,
            read: &mut read,
        };
        let basis = compress_long(&mut clip, 0.01, SILENT).unwrap();
        assert!(basis.max_error <= 0.01, "{}", basis.max_error);
        assert!(largest_read <= FITTED);
        let shown = basis.displacements() - frames(0..20_000);
        let farthest = longest_square(shown.as_slice().unwrap()).sqrt();
        assert!((farthest - basis.max_error).abs() < 1e-4, "{farthest}");
        for column in basis.weights.columns() {
            let largest = column.iter().fold(0.0f32, |most, w| most.max(w.abs()));
            assert_eq!(largest, 1.0);
        }
        let moving = basis.weights.iter().filter(|w| **w != 0.0).count();
        assert!(moving < basis.weights.len(), "all of {moving} move");
    }

    #[test]
    fn a_clip_at_rest_has_no_shapes_and_a_cancelled_one_no_result() {
        let mut read = |range: Range<usize>| Ok(Array3::zeros((range.len(), 3, 3)));
        let mut clip = LongClip {
            frames: 4_000,
            vertices: 3,
            fps: 25.0,
            read: &mut read,
        };
        let basis = compress_long(&mut clip, 0.01, SILENT).unwrap();
        assert_eq!((basis.shapes.dim().0, basis.weights.dim()), (0, (4_000, 0)));
        let ended = compress_long(&mut clip, 0.01, &|_| false);
        assert!(matches!(ended, Err(crate::Error::Cancelled)));
    }
}
