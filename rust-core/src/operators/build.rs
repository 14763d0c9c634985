//! Builds the operators of a mesh: chooses the vertices that take part and numbers their rows.

use glam::DVec3;

use super::{intrinsic::Intrinsic, laplacian::robust, sparse::Csr};
use crate::{
    Error, Result,
    mesh::{Mesh, Parts, parts::weld_seams},
};

/// Marks a vertex that has no row.
pub const NO_ROW: u32 = u32::MAX;

/// How operators are built.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatorOptions {
    /// Share of the mean edge length by which triangle inequalities are made strict; at least 0,
    /// below 1.
    pub mollify: f64,
    /// Whether to sew up vertices that are split along texture seams, see [`weld_seams`].
    pub weld: bool,
    /// Vertices that welding leaves alone.
    pub keep_apart: Vec<u32>,
}

impl Default for OperatorOptions {
    fn default() -> Self {
        OperatorOptions {
            mollify: 1e-5,
            weld: true,
            keep_apart: Vec::new(),
        }
    }
}

/// Operators of a mesh or of some of its faces, with `R` rows. Vertices in no face have no row;
/// vertices sewn together share one.
///
/// Scaling the mesh by `s` leaves the Laplacian unchanged and scales masses by `s²`.
#[derive(Debug, Clone)]
pub struct Operators {
    /// `[V]`, row of each mesh vertex or [`NO_ROW`].
    pub row_of_vertex: Vec<u32>,
    /// `[R]`, the mesh vertex that stands for each row.
    pub vertex_of_row: Vec<u32>,
    /// `[R]`, mesh units.
    pub positions: Vec<DVec3>,
    /// `[F']`, corners as rows; faces with repeated corners are left out.
    pub triangles: Vec<[u32; 3]>,
    /// `[R, R]`, weak Laplacian: symmetric, positive semi-definite, rows sum to zero, unitless.
    pub laplacian: Csr,
    /// `[R]`, lumped mass, mesh units squared; positive.
    pub mass: Vec<f64>,
    /// Connected parts of the rows.
    pub parts: Parts,
    pub(crate) cover: Intrinsic,
}

impl Operators {
    /// Operators of the whole mesh.
    ///
    /// # Errors
    /// `Mesh` if no face is usable, a vertex has no area or a weight is infinite; `InvalidInput`
    /// for options out of range.
    pub fn new(mesh: &Mesh, options: &OperatorOptions) -> Result<Operators> {
        build(mesh, &mesh.triangles, options)
    }

    /// Operators of the faces numbered in `faces`, such as the skin of a head.
    ///
    /// # Errors
    /// Those of [`Operators::new`]; `InvalidInput` for a face number out of range.
    pub fn of_faces(mesh: &Mesh, faces: &[u32], options: &OperatorOptions) -> Result<Operators> {
        let count = mesh.triangles.len();
        if let Some(&f) = faces.iter().find(|&&f| f as usize >= count) {
            return Err(Error::InvalidInput(format!(
                "faces: expected numbers below {count}, got {f}"
            )));
        }
        let chosen: Vec<_> = faces.iter().map(|&f| mesh.triangles[f as usize]).collect();
        build(mesh, &chosen, options)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.mass.len()
    }

    /// Area of the surface, mesh units squared.
    pub fn area(&self) -> f64 {
        self.mass.iter().sum()
    }
}

fn build(mesh: &Mesh, faces: &[[u32; 3]], options: &OperatorOptions) -> Result<Operators> {
    if !(0.0..1.0).contains(&options.mollify) {
        return Err(Error::InvalidInput(format!(
            "mollify: expected 0 to 1, got {}",
            options.mollify
        )));
    }
    let welded = weld(mesh, faces, options);
    let (row_of_vertex, vertex_of_row) = number_rows(&welded, faces);
    let triangles = proper_triangles(faces, &row_of_vertex);
    if triangles.is_empty() {
        return Err(Error::Mesh(format!(
            "expected at least one face with three different corners, got none among {}",
            faces.len()
        )));
    }
    let positions: Vec<_> = vertex_of_row.iter().map(|&v| mesh.point(v)).collect();
    let robust = robust(&positions, &triangles, options.mollify);
    check_finite(&robust.laplacian.values, &robust.mass)?;
    Ok(Operators {
        parts: Parts::of(positions.len(), &triangles),
        row_of_vertex,
        vertex_of_row,
        positions,
        triangles,
        laplacian: robust.laplacian,
        mass: robust.mass,
        cover: robust.cover,
    })
}

fn weld(mesh: &Mesh, faces: &[[u32; 3]], options: &OperatorOptions) -> Vec<u32> {
    if options.weld {
        weld_seams(&mesh.positions, faces, &options.keep_apart)
    } else {
        (0..mesh.positions.len() as u32).collect()
    }
}

fn is_proper(t: [u32; 3]) -> bool {
    t[0] != t[1] && t[1] != t[2] && t[2] != t[0]
}

/// Gives a row to each vertex with a proper face, in vertex order.
fn number_rows(welded: &[u32], faces: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut used = vec![false; welded.len()];
    for t in faces.iter().map(|t| t.map(|v| welded[v as usize])) {
        if is_proper(t) {
            for v in t {
                used[v as usize] = true;
            }
        }
    }
    let mut row_of_vertex = vec![NO_ROW; welded.len()];
    let mut vertex_of_row = Vec::new();
    for v in 0..welded.len() {
        let stands_for = welded[v] as usize;
        if stands_for == v && used[v] {
            row_of_vertex[v] = vertex_of_row.len() as u32;
            vertex_of_row.push(v as u32);
        } else {
            // The smallest vertex of a group stands for it, so its row is known already.
            row_of_vertex[v] = row_of_vertex[stands_for];
        }
    }
    (row_of_vertex, vertex_of_row)
}

fn proper_triangles(faces: &[[u32; 3]], row_of_vertex: &[u32]) -> Vec<[u32; 3]> {
    let rows = faces.iter().map(|t| t.map(|v| row_of_vertex[v as usize]));
    rows.filter(|&t| is_proper(t)).collect()
}

fn check_finite(laplacian: &[f64], mass: &[f64]) -> Result<()> {
    let bad = laplacian.iter().filter(|v| !v.is_finite()).count();
    let massless = mass
        .iter()
        .filter(|&&m| !(m > 0.0 && m.is_finite()))
        .count();
    if bad + massless > 0 {
        return Err(Error::Mesh(format!(
            "expected faces with area, got {massless} vertices without and {bad} infinite weights"
        )));
    }
    Ok(())
}
