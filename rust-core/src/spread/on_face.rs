//! Carries values at the vertices of a system's template to another mesh.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use crate::{
    Result,
    deform::{FollowingFace, ReferencePoints},
    face::Face,
    motion::Template,
};

const DM_PER_M: f32 = 10.0;

/// Carries a field over a template's vertices, `[V', C]`, to the vertices of a face, `[V, C]`.
/// Vertices that do not follow the skin of the face get 0.
///
/// # Errors
/// `Mesh` if the landmarks of the face lie on no usable face.
pub fn on_face(
    face: &Face,
    template: &Template,
    field: ArrayView2<'_, f32>,
) -> Result<Array2<f32>> {
    let surface = face.surface()?;
    let (positions, landmarks) = surface.decimetres();
    let decimetres = |p: [f32; 3]| p.map(|x| DM_PER_M * x);
    let points = template.mesh.positions.iter().copied();
    let reference = ReferencePoints {
        points: points.map(decimetres).collect(),
        normals: template.mesh.vertex_normals(),
        landmarks: template.landmark_positions().map(decimetres),
    };
    let rows = reference
        .carried_to(FollowingFace {
            positions: &positions,
            triangles: &surface.skin.operators.triangles,
            landmarks: &landmarks,
        })
        .of(field);
    let mut out = Array2::zeros((face.mesh.positions.len(), field.ncols()));
    let vertices = out.outer_iter_mut().into_par_iter().enumerate();
    vertices.for_each(|(v, mut out)| {
        for (row, share) in surface.rows_followed(v) {
            out.scaled_add(share, &rows.row(row));
        }
    });
    Ok(out)
}
