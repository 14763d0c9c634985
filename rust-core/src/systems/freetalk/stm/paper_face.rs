//! One mesh prepared for the `paper` decoder.

use std::sync::Arc;

use glam::DVec3;
use ndarray::{Array2, Array3, ArrayView3, Axis, s};
use rayon::prelude::*;

use super::paper::{INPUTS, MeshFeatures, PaperDecoder};
use crate::{
    Error, Result,
    cache::Cache,
    deform::{Corrected, SolvedSkin},
    face::{Deformer, Face, FaceSurface, proxy::Prolongation},
    job::{ProgressFn, Watch, report},
    mesh::{Mesh, Similarity, ibug::LANDMARKS},
    nn::surface::Surface,
    operators::{NO_ROW, OperatorOptions, Operators},
};

/// The network works only on skin within this distance of a landmark, canonical centimetres. It was
/// trained on faces and heads. On a whole bust the first eigenfunctions separate the shoulders and
/// not the lips, and the mouth opens half as wide.
const REACH_CM: f64 = 9.0;
/// The motion fades out over the last part of this distance, canonical centimetres.
const FADE_CM: f64 = 3.0;

/// FreeTalk's decoder on one mesh; runs the network for every frame.
pub struct PaperFace {
    decoder: Arc<PaperDecoder>,
    features: MeshFeatures,
    /// The skin within [`REACH_CM`], decimetres.
    surface: Surface,
    /// `[R]`, the share of its motion that each row of the surface keeps: 1 except near the rim.
    fade: Vec<f32>,
    /// `[V, R]`, the rows of the surface that each vertex follows, and their shares.
    follows: Prolongation,
    to_canonical: Similarity,
}

/// Prepares the decoder for one face. Computes the operators and the eigenbasis of the skin near
/// the landmarks, which go into `cache`, and the features of the neutral mesh. Units and axes are
/// those of the mesh. The engine gives such a face no proxy, so the work covers every vertex of
/// this skin.
///
/// # Errors
/// `Mesh` if the landmarks lie on no usable face, `Numerics` if a solve fails, `Cancelled`.
pub fn prepare_paper(
    decoder: Arc<PaperDecoder>,
    face: &Face,
    cache: &Cache,
    progress: ProgressFn<'_>,
) -> Result<Corrected<PaperFace>> {
    let solved = SolvedSkin::new(face, cache, progress)?;
    let config = decoder.config();
    let near = SkinNearby::of(solved.surface)?;
    let surface = near
        .operators
        .surface(config.eigenpairs, 10.0, cache, progress)?;
    report(progress, "weights", 0.9)?;
    let features = decoder.encode(near.vertex_inputs(), &surface);
    report(progress, "weights", 1.0)?;
    let follows = near.rows_followed(solved.surface);
    Ok(solved.corrected(PaperFace {
        decoder,
        features,
        surface,
        fade: near.fade,
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
        let mut out = Array3::zeros((frames, self.follows.rows(), 3));
        let batch = self.decoder.frames_at_once(self.surface.vertices());
        for first in (0..frames).step_by(batch) {
            report(progress, "deform", first as f32 / frames as f32)?;
            let range = s![first..(first + batch).min(frames), .., ..];
            let decimetres = self.to_decimetres(landmarks.slice(range));
            let moved = self.decoder.decode(
                &self.features,
                decimetres.view(),
                &self.surface,
                &Watch::new(progress, "deform", first as f32 / frames as f32),
            )?;
            let moved = self.to_mesh(moved);
            let mut targets = out.slice_mut(range);
            let frames = targets.axis_iter_mut(Axis(0)).zip(moved.axis_iter(Axis(0)));
            for (mut target, moved) in frames {
                for v in 0..self.follows.rows() {
                    for (row, share) in self.follows.row(v as u32) {
                        let row = row as usize;
                        for axis in 0..3 {
                            target[[v, axis]] += share * self.fade[row] * moved[[row, axis]];
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
        let mut out = Array3::zeros((of_skin.dim().0, self.follows.rows(), LANDMARKS));
        for (mut shares, skin) in out.outer_iter_mut().zip(of_skin.outer_iter()) {
            for (v, mut row) in shares.outer_iter_mut().enumerate() {
                for (from, share) in self.follows.row(v as u32) {
                    row.scaled_add(share, &skin.row(from as usize));
                }
            }
        }
        Some(out)
    }
}

impl PaperFace {
    /// Converts mesh displacements to canonical decimetres.
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

    /// Converts canonical decimetres to mesh displacements.
    fn to_mesh(&self, decimetres: Array3<f32>) -> Array3<f32> {
        let metres = decimetres * 0.1;
        self.to_canonical.displacements_to_mesh(metres.view())
    }
}

/// The skin within [`REACH_CM`] of the landmarks.
struct SkinNearby {
    operators: Operators,
    /// `[R]`, the share of its motion that each row keeps: 1 except near the rim.
    fade: Vec<f32>,
}

impl SkinNearby {
    fn of(face: &FaceSurface) -> Result<Self> {
        let skin = &face.skin.operators;
        let distance = |p: &DVec3| {
            let to = |l: &[f32; 3]| p.distance(DVec3::from(l.map(f64::from)));
            face.landmarks.iter().map(to).fold(f64::INFINITY, f64::min)
        };
        let distances: Vec<f64> = skin.positions.par_iter().map(distance).collect();
        let is_near = |t: &[u32; 3]| t.iter().all(|&row| distances[row as usize] < REACH_CM);
        let faces: Vec<u32> = (0..skin.triangles.len() as u32)
            .filter(|&f| is_near(&skin.triangles[f as usize]))
            .collect();
        let mesh = Mesh {
            positions: skin
                .positions
                .iter()
                .map(|p| p.as_vec3().to_array())
                .collect(),
            triangles: skin.triangles.clone(),
        };
        let options = OperatorOptions {
            weld: false,
            ..OperatorOptions::default()
        };
        let operators = Operators::of_faces(&mesh, &faces, &options)?;
        let share =
            |&row: &u32| ((REACH_CM - distances[row as usize]) / FADE_CM).clamp(0.0, 1.0) as f32;
        let fade = operators.vertex_of_row.iter().map(share).collect();
        Ok(SkinNearby { operators, fade })
    }

    /// Position in decimetres and normal of each row, `[R, 6]`.
    fn vertex_inputs(&self) -> Array2<f32> {
        let frames = self.operators.tangent_frames();
        let positions = &self.operators.positions;
        Array2::from_shape_fn((positions.len(), INPUTS), |(v, channel)| match channel {
            0..3 => 0.1 * positions[v][channel] as f32,
            _ => frames[v][2][channel - 3] as f32,
        })
    }

    /// `[V, R]`, the rows that each vertex of the mesh follows, and their shares. A vertex that
    /// follows any row outside this skin gets none.
    fn rows_followed(&self, face: &FaceSurface) -> Prolongation {
        let near = |(row, share): (usize, f32)| match self.operators.row_of_vertex[row] {
            NO_ROW => None,
            row => Some((row, share)),
        };
        let rows = |v| face.rows_followed(v).map(near).collect::<Option<Vec<_>>>();
        let all = (0..face.follows.len()).map(|v| rows(v).unwrap_or_default());
        Prolongation::from_rows(all)
    }
}
