//! One mesh prepared for the `paper` decoder.

use std::sync::Arc;

use ndarray::{Array2, Array3, ArrayView3, Axis, s};

use super::paper::{INPUTS, MeshFeatures, PaperDecoder};
use crate::{
    Error, Result,
    cache::Cache,
    deform::{Corrected, SolvedSkin},
    face::{Deformer, Face, FaceSurface, binding::Follows},
    job::{ProgressFn, report},
    mesh::{Similarity, ibug::LANDMARKS},
    nn::surface::Surface,
};

/// FreeTalk's decoder on one mesh; runs the network for every frame.
pub struct PaperFace {
    decoder: Arc<PaperDecoder>,
    features: MeshFeatures,
    /// Of the skin, decimetres.
    surface: Surface,
    /// `[V]`, the rows of the skin that each vertex follows, and by which shares.
    follows: Vec<[(u32, f32); 3]>,
    to_canonical: Similarity,
}

/// Prepares the decoder for one face: operators and eigenbasis of the skin (kept in `cache`) and the
/// features of the neutral mesh. Units and axes are the mesh's own. Every vertex of the skin is worked
/// on: the face has no proxy.
///
/// # Errors
/// `Mesh` if the landmarks lie on no usable face, `Numerics` if a solve fails,
/// `Cancelled`.
pub fn prepare_paper(
    decoder: Arc<PaperDecoder>,
    face: &Face,
    cache: &Cache,
    progress: ProgressFn<'_>,
) -> Result<Corrected<PaperFace>> {
    let solved = SolvedSkin::new(face, cache, progress)?;
    let config = decoder.config();
    let operators = &solved.surface.skin.operators;
    let surface = operators.surface(config.eigenpairs, 10.0, cache)?;
    report(progress, "weights", 0.9)?;
    let features = decoder.encode(vertex_inputs(solved.surface), &surface);
    report(progress, "weights", 1.0)?;
    let follows = rows_followed(solved.surface);
    Ok(solved.corrected(PaperFace {
        decoder,
        features,
        surface,
        follows,
        to_canonical: face.to_canonical,
    }))
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
        let mut out = Array3::zeros((frames, self.follows.len(), 3));
        let batch = self.decoder.frames_at_once(self.surface.vertices());
        for first in (0..frames).step_by(batch) {
            report(progress, "deform", first as f32 / frames as f32)?;
            let range = s![first..(first + batch).min(frames), .., ..];
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

    fn attention(&self, landmarks: ArrayView3<'_, f32>) -> Option<Array3<f32>> {
        let decimetres = self.to_decimetres(landmarks);
        let of_skin = self.decoder.attention(&self.features, decimetres.view());
        let mut out = Array3::zeros((of_skin.dim().0, self.follows.len(), LANDMARKS));
        for (mut shares, skin) in out.outer_iter_mut().zip(of_skin.outer_iter()) {
            for (mut row, follows) in shares.outer_iter_mut().zip(&self.follows) {
                for &(from, share) in follows.iter().filter(|(_, share)| *share != 0.0) {
                    row.scaled_add(share, &skin.row(from as usize));
                }
            }
        }
        Some(out)
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

/// Position in decimetres and normal. `[R, 6]`.
fn vertex_inputs(face: &FaceSurface) -> Array2<f32> {
    let (positions, _) = face.decimetres();
    let frames = face.skin.operators.tangent_frames();
    Array2::from_shape_fn((positions.len(), INPUTS), |(v, channel)| match channel {
        0..3 => positions[v][channel],
        _ => frames[v][2][channel - 3] as f32,
    })
}

/// `[V]`, the rows of the skin that each vertex follows, and by which shares. For a skin without
/// a proxy.
fn rows_followed(face: &FaceSurface) -> Vec<[(u32, f32); 3]> {
    let row = |(skin, share): (u32, f32)| match face.skin.spread.row(skin).next() {
        Some((row, _)) => (row, share),
        None => (0, 0.0),
    };
    let follows = face.follows.iter();
    follows
        .map(|follows| match *follows {
            Follows::Skin(corners) => corners.map(row),
            _ => [(0, 0.0); 3],
        })
        .collect()
}
