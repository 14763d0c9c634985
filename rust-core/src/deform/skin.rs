//! The part of a mesh on which landmark motion is solved.

use super::{nearest::PointGrid, part_list::PartList};
use crate::{
    Error, Result,
    mesh::{
        Mesh, PartRole, Parts,
        lips::{Lip, lip_of_vertices},
        parts::weld_seams,
    },
    motion::LANDMARKS,
    operators::{NO_ROW, OperatorOptions, Operators},
};

/// A part with fewer landmarks than this (lashes, a brow) is not skin; its landmarks move to the
/// skin beside it.
const LANDMARKS_OF_SKIN: usize = 7;
/// How far along the surface a lip is followed when lips are told apart, centimetres.
const LIP_CM: f32 = 4.0;
/// A landmark further from any skin than this is an error, centimetres.
const LOST_CM: f32 = 5.0;

/// The connected parts that carry landmarks, and their operators.
pub struct Skin {
    /// `[V]`, whether a vertex is skin with a row.
    pub is_skin: Vec<bool>,
    /// Of the skin, canonical centimetres; `R` rows.
    pub operators: Operators,
    /// Row of each landmark.
    pub landmark_rows: [u32; LANDMARKS],
}

impl Skin {
    /// Finds it. `mesh` and `landmarks` in canonical centimetres; `vertices`: nearest vertex of
    /// each landmark; `list`: the parts of the mesh.
    ///
    /// # Errors
    /// `Mesh` if no landmark lies on a usable face.
    pub fn find(
        mesh: &Mesh,
        landmarks: &[[f32; 3]; LANDMARKS],
        vertices: &[u32; LANDMARKS],
        list: &PartList,
    ) -> Result<Skin> {
        let is_skin: Vec<bool> = (0..mesh.positions.len())
            .map(|v| list.is(v, PartRole::Skin))
            .collect();
        let faces: Vec<u32> = (0..mesh.triangles.len() as u32)
            .filter(|&f| is_skin[mesh.triangles[f as usize][0] as usize])
            .collect();
        let options = OperatorOptions {
            keep_apart: list.keep_apart.clone(),
            ..OperatorOptions::default()
        };
        let operators = Operators::of_faces(mesh, &faces, &options)?;
        let landmark_rows = rows_of_landmarks(&operators, landmarks, vertices)?;
        // A vertex of collapsed faces alone has no row: it follows the skin beside it.
        let is_skin = is_skin.iter().zip(&operators.row_of_vertex);
        let is_skin = is_skin.map(|(&skin, &row)| skin && row != NO_ROW).collect();
        Ok(Skin {
            is_skin,
            operators,
            landmark_rows,
        })
    }
}

/// Vertices of closed lips that only coincide: sewing them up would glue the mouth.
pub(super) fn touching_lips(mesh: &Mesh, vertices: &[u32; LANDMARKS]) -> Vec<u32> {
    let groups = weld_seams(&mesh.positions, &mesh.triangles, &[]);
    let sewn: Vec<u32> = (0..groups.len() as u32)
        .filter(|&v| groups[v as usize] != v)
        .collect();
    if sewn.is_empty() {
        return Vec::new();
    }
    let lips = lip_of_vertices(mesh, &vertices[49..54], &vertices[55..60], LIP_CM);
    let differ = |v: u32| {
        let pair = (lips[v as usize], lips[groups[v as usize] as usize]);
        matches!(
            pair,
            (Some(Lip::Upper), Some(Lip::Lower)) | (Some(Lip::Lower), Some(Lip::Upper))
        )
    };
    let apart = sewn.into_iter().filter(|&v| differ(v));
    apart.flat_map(|v| [v, groups[v as usize]]).collect()
}

pub(super) fn sewn_parts(mesh: &Mesh, keep_apart: &[u32]) -> Parts {
    let groups = weld_seams(&mesh.positions, &mesh.triangles, keep_apart);
    let sewn = mesh.triangles.iter().map(|t| t.map(|v| groups[v as usize]));
    let mut parts = Parts::of(mesh.positions.len(), &sewn.collect::<Vec<_>>());
    for v in 0..groups.len() {
        parts.of_vertex[v] = parts.of_vertex[groups[v] as usize];
    }
    parts
}

/// `[parts]`, whether a part is skin.
pub(super) fn parts_of_skin(parts: &Parts, vertices: &[u32; LANDMARKS]) -> Result<Vec<bool>> {
    let mut count = vec![0; parts.count];
    for &v in vertices {
        if let Some(count) = count.get_mut(parts.of_vertex[v as usize] as usize) {
            *count += 1;
        }
    }
    let most = count.iter().copied().max().unwrap_or(0);
    if most == 0 {
        return Err(Error::Mesh(
            "expected landmarks on faces, got all 68 on vertices without a face".into(),
        ));
    }
    let needed = LANDMARKS_OF_SKIN.min(most);
    Ok(count.iter().map(|&c| c >= needed).collect())
}

fn rows_of_landmarks(
    operators: &Operators,
    landmarks: &[[f32; 3]; LANDMARKS],
    vertices: &[u32; LANDMARKS],
) -> Result<[u32; LANDMARKS]> {
    let points: Vec<[f32; 3]> = operators
        .positions
        .iter()
        .map(|p| p.map(|x| x as f32))
        .collect();
    let grid = PointGrid::new(&points, 0.5);
    let mut rows = [0; LANDMARKS];
    for (n, row) in rows.iter_mut().enumerate() {
        let own = operators.row_of_vertex[vertices[n] as usize];
        *row = match own {
            NO_ROW => {
                let found = grid.nearest(landmarks[n], LOST_CM);
                found.map(|(row, _)| row).ok_or_else(|| {
                    Error::Mesh(format!(
                        "landmark {n}: expected skin within {LOST_CM} cm on a human-sized head, \
                         got none"
                    ))
                })?
            }
            row => row,
        };
    }
    Ok(rows)
}
