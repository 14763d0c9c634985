//! The part of a mesh on which landmark motion is solved.

use super::{
    nearest::PointGrid,
    part_list::PartList,
    proxy::{Prolongation, Proxy},
};
use crate::{
    Error, Result,
    mesh::{Mesh, PartRole, ibug::LANDMARKS, parts::weld_seams},
    operators::{NO_ROW, OperatorOptions, Operators},
};

/// A landmark further from the skin than this is an error, centimetres.
const LOST_CM: f32 = 5.0;

/// The connected parts that carry landmarks, and their operators.
pub struct Skin {
    /// `[V]`, whether a vertex is skin. A vertex whose faces have all collapsed is not: it follows
    /// the skin beside it.
    pub is_skin: Vec<bool>,
    /// `[V]`, for each vertex the one that stands for it when seams are sewn up.
    pub(crate) sewn: Vec<u32>,
    /// Triangles of the skin, seams sewn up, over all positions; canonical centimetres.
    pub(crate) surface: Mesh,
    /// Vertex of the surface at each landmark.
    pub(crate) landmark_vertices: [u32; LANDMARKS],
    /// Operators of the surface or its proxy; `R` rows.
    pub operators: Operators,
    /// `[V, R]`: carries values at the rows to the skin's vertices.
    pub spread: Prolongation,
    /// Row of each landmark.
    pub landmark_rows: [u32; LANDMARKS],
}

impl Skin {
    /// Finds the skin. `mesh` and `landmarks`: canonical centimetres. `vertices`: the vertex
    /// nearest to each landmark. `list`: the parts of the mesh. With a `limit` the solve works on a
    /// [`Proxy`] of at most that many vertices.
    ///
    /// # Errors
    /// `Mesh` if no landmark lies on a usable face.
    pub fn find(
        mesh: &Mesh,
        landmarks: &[[f32; 3]; LANDMARKS],
        vertices: &[u32; LANDMARKS],
        list: &PartList,
        limit: Option<usize>,
    ) -> Result<Skin> {
        let faces: Vec<[u32; 3]> = (mesh.triangles.iter().copied())
            .filter(|t| list.is(t[0] as usize, PartRole::Skin))
            .collect();
        let sewn = weld_seams(&mesh.positions, &faces, &list.keep_apart);
        let surface = Mesh {
            positions: mesh.positions.clone(),
            triangles: sewn_triangles(&faces, &sewn),
        };
        let is_skin = skin_vertices(&surface, &sewn);
        let landmark_vertices = landmarks_on_skin(&surface, &sewn, &is_skin, landmarks, vertices)?;
        let mut anchors = landmark_vertices;
        let (operators, proxy) = solved_on(&surface, landmarks, &mut anchors, limit)?;
        let spread = spread(&operators, proxy.as_ref(), &sewn, &is_skin);
        Ok(Skin {
            landmark_rows: anchors.map(|v| operators.row_of_vertex[v as usize]),
            is_skin,
            sewn,
            surface,
            landmark_vertices,
            operators,
            spread,
        })
    }
}

/// The triangles after sewing, without those that collapse.
fn sewn_triangles(faces: &[[u32; 3]], sewn: &[u32]) -> Vec<[u32; 3]> {
    let triangles = faces.iter().map(|t| t.map(|v| sewn[v as usize]));
    triangles
        .filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
        .collect()
}

/// `[V]`, whether the vertex that stands for each is a corner of the surface.
fn skin_vertices(surface: &Mesh, sewn: &[u32]) -> Vec<bool> {
    let mut corner = vec![false; sewn.len()];
    let corners = surface.triangles.as_flattened().iter();
    corners.for_each(|&v| corner[v as usize] = true);
    sewn.iter().map(|&v| corner[v as usize]).collect()
}

/// The vertex of the surface at each landmark: its own, or the nearest skin where its own is not
/// skin.
fn landmarks_on_skin(
    surface: &Mesh,
    sewn: &[u32],
    is_skin: &[bool],
    landmarks: &[[f32; 3]; LANDMARKS],
    vertices: &[u32; LANDMARKS],
) -> Result<[u32; LANDMARKS]> {
    let mut on_skin = vertices.map(|v| sewn[v as usize]);
    if on_skin.iter().all(|&v| is_skin[v as usize]) {
        return Ok(on_skin);
    }
    let skin_vertices: Vec<u32> = (0..sewn.len() as u32)
        .filter(|&v| is_skin[v as usize] && sewn[v as usize] == v)
        .collect();
    let points: Vec<[f32; 3]> = skin_vertices
        .iter()
        .map(|&v| surface.positions[v as usize])
        .collect();
    let grid = PointGrid::new(&points, 0.5);
    for (n, vertex) in on_skin.iter_mut().enumerate() {
        if !is_skin[*vertex as usize] {
            let (nearest, _) = grid.nearest(landmarks[n], LOST_CM).ok_or_else(|| {
                Error::Mesh(format!(
                    "landmark {n}: expected skin within {LOST_CM} cm on a human-sized head, got none"
                ))
            })?;
            *vertex = skin_vertices[nearest as usize];
        }
    }
    Ok(on_skin)
}

/// Operators of a proxy of at most `limit` vertices, or of the surface itself. `anchors`: on entry
/// the vertex at each landmark, on return the landmark's own.
fn solved_on(
    surface: &Mesh,
    landmarks: &[[f32; 3]; LANDMARKS],
    anchors: &mut [u32; LANDMARKS],
    limit: Option<usize>,
) -> Result<(Operators, Option<Proxy>)> {
    let options = OperatorOptions {
        weld: false,
        ..OperatorOptions::default()
    };
    let Some(limit) = limit else {
        return Ok((Operators::new(surface, &options)?, None));
    };
    let (positions, triangles) = (&surface.positions, &surface.triangles);
    let proxy = Proxy::build(positions, triangles, landmarks, anchors, limit);
    Ok((Operators::new(&proxy.mesh, &options)?, Some(proxy)))
}

/// The matrix that carries values from the rows of the operators to the vertices of the mesh.
fn spread(
    operators: &Operators,
    proxy: Option<&Proxy>,
    sewn: &[u32],
    is_skin: &[bool],
) -> Prolongation {
    let row = |(vertex, weight): (u32, f32)| {
        let row = operators.row_of_vertex[vertex as usize];
        (row != NO_ROW).then_some((row, weight))
    };
    let rows = (0..sewn.len()).map(|v| match (is_skin[v], proxy) {
        (false, _) => Vec::new(),
        (true, None) => row((sewn[v], 1.0)).into_iter().collect(),
        (true, Some(proxy)) => proxy.prolongation.row(sewn[v]).filter_map(row).collect(),
    });
    Prolongation::from_rows(rows)
}
