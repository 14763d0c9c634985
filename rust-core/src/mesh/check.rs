//! Refuses unusable meshes and counts the oddities of usable ones.

use std::collections::HashMap;

use serde::Serialize;

use super::{
    Mesh, Parts,
    parts::{DisjointSets, NO_PART, boundary_edges},
};
use crate::{Error, Result};

/// The fewest triangles that a mesh may have: those of a tetrahedron.
const MIN_TRIANGLES: usize = 4;
/// The least size of a mesh as a share of its distance from the origin. Floats have 24 bits: of a
/// smaller mesh they know fewer than 4096 places along its longest side.
const LEAST_SHARE: f32 = 1.0 / 4096.0;

/// Counts of a mesh's elements and oddities. None of the oddities makes it unusable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct MeshReport {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Parts connected by edges.
    pub parts: usize,
    /// Vertices in no face.
    pub loose_vertices: usize,
    /// Faces with the same three corners as an earlier one.
    pub duplicate_faces: usize,
    /// Faces with a repeated corner or without area.
    pub degenerate_faces: usize,
    /// Edges with three faces or more.
    pub nonmanifold_edges: usize,
    /// Edges with one face.
    pub boundary_edges: usize,
    /// Connected groups of boundary edges. Each is one hole, except where holes touch.
    pub holes: usize,
}

impl Mesh {
    /// Checks that the mesh is usable at all.
    ///
    /// # Errors
    /// `Mesh` if there is no vertex, there are fewer than 4 faces, a vertex is not finite (the
    /// error says how many and names the first), the mesh is too far from the origin for its size,
    /// or a face names a vertex that does not exist.
    pub fn check(&self) -> Result<()> {
        let vertices = self.positions.len();
        if vertices == 0 {
            return Err(Error::Mesh("expected vertices, got none".into()));
        }
        let is_bad = |p: &[f32; 3]| !p.iter().all(|x| x.is_finite());
        if let Some(first) = self.positions.iter().position(is_bad) {
            let bad = self.positions.iter().filter(|p| is_bad(p)).count();
            return Err(Error::Mesh(format!(
                "expected finite positions, got NaN or infinity at {bad} of {vertices} vertices, the first is vertex {first} at {:?}",
                self.positions[first]
            )));
        }
        self.check_place()?;
        if self.triangles.len() < MIN_TRIANGLES {
            return Err(Error::Mesh(format!(
                "expected at least {MIN_TRIANGLES} triangles, got {}",
                self.triangles.len()
            )));
        }
        let outside = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= vertices);
        if let Some(face) = self.triangles.iter().position(outside) {
            return Err(Error::Mesh(format!(
                "face {face}: expected vertex numbers below {vertices}, got {:?}",
                self.triangles[face]
            )));
        }
        Ok(())
    }

    /// Refuses a mesh in map coordinates, of which floats keep too little.
    fn check_place(&self) -> Result<()> {
        let fold = |start: f32, of: fn(f32, f32) -> f32| {
            let all = self.positions.iter();
            all.fold([start; 3], |ends, p| [0, 1, 2].map(|i| of(ends[i], p[i])))
        };
        let (low, high) = (
            fold(f32::INFINITY, f32::min),
            fold(f32::NEG_INFINITY, f32::max),
        );
        let size = [0, 1, 2]
            .map(|i| high[i] - low[i])
            .into_iter()
            .fold(0.0, f32::max);
        let far = low
            .iter()
            .chain(&high)
            .fold(0.0, |far: f32, x| far.max(x.abs()));
        if size > 0.0 && size < LEAST_SHARE * far {
            return Err(Error::Mesh(format!(
                "expected a mesh near the origin, got one of size {size} at a distance of {far}, where positions of 32 bits \
                 are too coarse for it; move it to the origin and save it anew (Blender: Object → Set Origin → Geometry to Origin)"
            )));
        }
        Ok(())
    }

    /// Counts the oddities of a mesh that passes [`Mesh::check`].
    ///
    /// # Panics
    /// If a face names a vertex that does not exist.
    pub fn report(&self) -> MeshReport {
        let parts = Parts::of(self.positions.len(), &self.triangles);
        let boundary = boundary_edges(&self.triangles);
        MeshReport {
            vertices: self.positions.len(),
            triangles: self.triangles.len(),
            parts: parts.count,
            loose_vertices: parts.of_vertex.iter().filter(|&&p| p == NO_PART).count(),
            duplicate_faces: self.duplicate_faces(),
            degenerate_faces: self.degenerate_faces(),
            nonmanifold_edges: self.nonmanifold_edges(),
            boundary_edges: boundary.len(),
            holes: groups(&boundary, self.positions.len()),
        }
    }

    fn duplicate_faces(&self) -> usize {
        let mut sorted: Vec<[u32; 3]> = self.triangles.clone();
        sorted.iter_mut().for_each(|t| t.sort_unstable());
        sorted.sort_unstable();
        sorted.windows(2).filter(|w| w[0] == w[1]).count()
    }

    fn degenerate_faces(&self) -> usize {
        let areas = self.face_areas();
        let repeated = |t: &[u32; 3]| t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
        let faces = self.triangles.iter().zip(areas);
        faces
            .filter(|(t, area)| repeated(t) || *area == 0.0)
            .count()
    }

    fn nonmanifold_edges(&self) -> usize {
        let mut faces: HashMap<(u32, u32), u32> = HashMap::new();
        for t in &self.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                *faces.entry((a.min(b), a.max(b))).or_default() += u32::from(a != b);
            }
        }
        faces.values().filter(|&&n| n > 2).count()
    }
}

fn groups(edges: &[(u32, u32)], vertices: usize) -> usize {
    let mut sets = DisjointSets::new(vertices);
    edges.iter().for_each(|&(a, b)| sets.join(a, b));
    let mut roots: Vec<u32> = edges.iter().map(|&(a, _)| sets.find(a)).collect();
    roots.sort_unstable();
    roots.dedup();
    roots.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> Mesh {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        Mesh::from_arrays(positions, triangles).unwrap()
    }

    #[test]
    fn a_sound_mesh_has_no_oddities() {
        let report = tetrahedron().report();
        assert_eq!((report.vertices, report.triangles, report.parts), (4, 4, 1));
        assert_eq!(
            report.loose_vertices + report.duplicate_faces + report.degenerate_faces,
            0
        );
        assert_eq!(
            report.nonmanifold_edges + report.boundary_edges + report.holes,
            0
        );
    }

    #[test]
    fn a_mesh_in_map_coordinates_is_refused() {
        let mut mesh = tetrahedron();
        let mut moved = |by: f32| {
            mesh.positions = tetrahedron().positions;
            mesh.positions.iter_mut().for_each(|p| p[1] += by);
            mesh.check()
        };
        moved(1000.0).unwrap();
        let message = moved(4e6).unwrap_err().to_string();
        assert!(message.contains("Geometry to Origin"), "{message}");
    }

    #[test]
    fn every_oddity_is_counted() {
        let mut mesh = tetrahedron();
        mesh.positions
            .extend([[2.0; 3], [3.0; 3], [4.0; 3], [5.0, 1.0, 0.0], [9.0; 3]]);
        // Three points on a line, a duplicate with turned corners, a flap, a repeated corner.
        mesh.triangles
            .extend([[4, 5, 6], [2, 3, 1], [0, 1, 7], [3, 3, 2]]);
        let report = mesh.report();
        assert_eq!(report.parts, 2);
        assert_eq!(report.loose_vertices, 1);
        assert_eq!(report.duplicate_faces, 1);
        assert_eq!(report.degenerate_faces, 2);
        assert_eq!(report.nonmanifold_edges, 4);
        assert_eq!(report.boundary_edges, 5);
        assert_eq!(report.holes, 2);
    }

    #[test]
    fn unusable_meshes_say_why() {
        let good = tetrahedron();
        let mut nan = good.clone();
        (nan.positions[1][2], nan.positions[3][0]) = (f32::NAN, f32::INFINITY);
        let mut beyond = good.clone();
        beyond.triangles[2] = [0, 1, 4];
        let mut small = good.clone();
        small.triangles.pop();
        let mut faceless = good.clone();
        faceless.triangles.clear();
        for (mesh, expected) in [
            (Mesh::default(), "expected vertices, got none"),
            (nan, "at 2 of 4 vertices, the first is vertex 1"),
            (
                beyond,
                "face 2: expected vertex numbers below 4, got [0, 1, 4]",
            ),
            (small, "expected at least 4 triangles, got 3"),
            (faceless, "expected at least 4 triangles, got 0"),
        ] {
            let error = mesh.check().unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
