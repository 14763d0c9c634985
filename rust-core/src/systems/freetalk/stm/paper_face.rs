//! One mesh prepared for the `paper` decoder.

use std::sync::Arc;

use ndarray::{Array3, ArrayView3, Axis, s};

use super::paper::{MeshFeatures, PaperDecoder};
use crate::{
    Error, Result,
    deform::{Deformer, LandmarkWeights},
    mesh::Similarity,
    motion::LANDMARKS,
    nn::surface::Surface,
    progress::{ProgressFn, report},
};

/// Frames decoded between two looks at the progress callback.
const FRAMES_PER_REPORT: usize = 8;

/// FreeTalk's decoder on one mesh; runs the network for every frame.
pub struct PaperFace {
    pub(super) decoder: Arc<PaperDecoder>,
    pub(super) features: MeshFeatures,
    /// Of the skin, decimetres.
    pub(super) surface: Surface,
    /// What the decoder adds to: the plate where the config says so, else nothing.
    pub(super) base: LandmarkWeights,
    /// `[V]`, the rows of the skin that each vertex follows, and by which shares.
    pub(super) follows: Vec<[(u32, f32); 3]>,
    pub(super) to_canonical: Similarity,
}

impl Deformer for PaperFace {
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
        let mut out = self.base.deform(landmarks, crate::progress::SILENT)?;
        for first in (0..frames).step_by(FRAMES_PER_REPORT) {
            report(progress, "deform", first as f32 / frames as f32)?;
            let range = s![first..(first + FRAMES_PER_REPORT).min(frames), .., ..];
            let decimetres = self.to_decimetres(landmarks.slice(range));
            let moved = self
                .decoder
                .decode(&self.features, decimetres.view(), &self.surface);
            let moved = self.to_mesh(moved);
            let mut targets = out.slice_mut(range);
            let frames = targets.axis_iter_mut(Axis(0)).zip(moved.axis_iter(Axis(0)));
            for (mut target, moved) in frames {
                for (v, follows) in self.follows.iter().enumerate() {
                    for &(row, share) in follows.iter().filter(|(_, share)| *share != 0.0) {
                        for axis in 0..3 {
                            target[[v, axis]] += share * moved[[row as usize, axis]];
                        }
                    }
                }
            }
        }
        report(progress, "deform", 1.0)?;
        Ok(out)
    }
}

impl PaperFace {
    /// Mesh displacements to canonical decimetres.
    fn to_decimetres(&self, landmarks: ArrayView3<'_, f32>) -> Array3<f32> {
        let scale = 10.0 * self.to_canonical.scale as f32;
        let mut out = landmarks.to_owned();
        for mut row in out.rows_mut() {
            let turned = self.to_canonical.rotate([row[0], row[1], row[2]]);
            for axis in 0..3 {
                row[axis] = scale * turned[axis];
            }
        }
        out
    }

    /// Canonical decimetres to mesh displacements.
    fn to_mesh(&self, decimetres: Array3<f32>) -> Array3<f32> {
        let metres = decimetres * 0.1;
        self.to_canonical.displacements_to_mesh(metres.view())
    }
}
