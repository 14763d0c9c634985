//! A head as a mesh: the surface in the canonical pose, moved to the face at rest.

use std::{ops::Range, sync::OnceLock};

use super::{OneHead, SURFACE_CELLS};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    mesh::{Landmarks, Mesh, Parts, ibug::LANDMARKS},
    sdf::{Grid, surface},
};

/// A head as a mesh at rest, metres: +x to the subject's left, +y up, +z out of the face.
#[derive(Debug, Clone, PartialEq)]
pub struct MadeHead {
    /// The skin, then the parts. A quad is two triangles.
    pub mesh: Mesh,
    /// The same surface as faces. A triangle repeats its last corner.
    pub faces: Vec<[u32; 4]>,
    /// Texture coordinates at the corners of the skin's faces; empty for a surface of the field.
    pub uv: Vec<[[f32; 2]; 4]>,
    /// Landmarks, each on a vertex of the skin.
    pub landmarks: Landmarks,
    /// The vertices in the canonical pose, for a surface of the field; empty for a head of quads.
    pub canonical: Vec<[f32; 3]>,
    /// Names of the objects, each with its vertices.
    pub objects: Vec<(String, Range<usize>)>,
    /// Names of materials, each with a range of faces.
    pub materials: Vec<(String, Range<usize>)>,
}

impl OneHead<'_> {
    /// The surface of this head's field, with `resolution` cells along the longest side of the grid.
    ///
    /// # Errors
    /// `InvalidInput` for a resolution below 32, above 4096 or so high that it needs more than 1
    /// GiB, and for a code without a surface; `Cancelled`.
    pub fn mesh(&self, resolution: usize, progress: ProgressFn<'_>) -> Result<MadeHead> {
        let least = *SURFACE_CELLS.start();
        if resolution < least {
            return Err(Error::InvalidInput(format!(
                "resolution: expected at least {least} cells along the longest side, as fewer leave no face, got \
                 {resolution}"
            )));
        }
        let skin = self.canonical_surface(resolution, progress)?;
        let Mesh {
            positions: mut canonical,
            triangles,
        } = skin;
        let vertices = self.put_on_vertices(&mut canonical);
        let mover = self.mover(canonical.clone());
        report(progress, "rest", 0.0)?;
        let positions = mover.at(&self.head.rest_code())?;
        let places = vertices.map(|v| positions[v as usize]);
        let head = MadeHead {
            landmarks: Landmarks {
                positions: places,
                vertices,
                confidence: [1.0; LANDMARKS],
            },
            canonical,
            objects: vec![("skin".to_owned(), 0..positions.len())],
            materials: vec![("skin".to_owned(), 0..triangles.len())],
            faces: triangles.iter().map(|[a, b, c]| [*a, *b, *c, *c]).collect(),
            uv: Vec::new(),
            mesh: Mesh {
                positions,
                triangles,
            },
        };
        report(progress, "rest", 1.0)?;
        Ok(head)
    }

    /// The surface of the canonical field.
    pub(super) fn canonical_surface(
        &self,
        resolution: usize,
        progress: ProgressFn<'_>,
    ) -> Result<Mesh> {
        let [low, high] = self.head.config.bounds_m;
        let grid = Grid::of_box(low, high, resolution)?;
        report(progress, "surface", 0.0)?;
        let stopped: OnceLock<Error> = OnceLock::new();
        let result = surface(grid, |points| {
            if let Err(error) = report(progress, "surface", 0.5) {
                let _ = stopped.set(error);
                return vec![f32::NAN; points.nrows()];
            }
            let points: Vec<[f32; 3]> = points.outer_iter().map(|p| [p[0], p[1], p[2]]).collect();
            self.distance(&points)
        });
        match stopped.into_inner() {
            Some(error) => Err(error),
            None => result.map(|mesh| largest_piece(&mesh)),
        }
    }

    /// Moves the nearest vertex that is still free onto each landmark. Returns the vertices'
    /// numbers.
    fn put_on_vertices(&self, vertices: &mut [[f32; 3]]) -> [u32; LANDMARKS] {
        let places = self.on_surface(self.landmarks());
        let mut chosen = [u32::MAX; LANDMARKS];
        for (number, place) in places.into_iter().enumerate() {
            let free = (0..vertices.len() as u32).filter(|v| !chosen[..number].contains(v));
            let nearest = free.min_by(|a, b| {
                let [a, b] = [a, b].map(|v| squared(vertices[*v as usize], place));
                a.total_cmp(&b)
            });
            if let Some(vertex) = nearest {
                vertices[vertex as usize] = place;
                chosen[number] = vertex;
            }
        }
        chosen
    }

    /// Moves canonical points near the surface onto it with three Newton steps along the gradient.
    pub fn on_surface(&self, mut points: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
        for _ in 0..3 {
            let (here, gradients) = (self.distance(&points), self.gradient(&points));
            for ((p, s), g) in points.iter_mut().zip(here).zip(gradients) {
                let steep = g.iter().map(|x| x * x).sum::<f32>().max(0.1);
                *p = std::array::from_fn(|axis| p[axis] - s * g[axis] / steep);
            }
        }
        points
    }
}

/// The connected piece with the most triangles. A learned field has specks of surface beside a
/// head.
fn largest_piece(mesh: &Mesh) -> Mesh {
    let pieces = Parts::of(mesh.positions.len(), &mesh.triangles);
    let piece = |t: &[u32; 3]| pieces.of_vertex[t[0] as usize];
    let mut sizes = vec![0usize; pieces.count];
    mesh.triangles
        .iter()
        .for_each(|t| sizes[piece(t) as usize] += 1);
    let largest = (0..pieces.count).max_by_key(|&n| sizes[n]).unwrap_or(0) as u32;
    let mut number = vec![0; mesh.positions.len()];
    let mut positions = Vec::new();
    for (v, place) in mesh.positions.iter().enumerate() {
        if pieces.of_vertex[v] == largest {
            number[v] = positions.len() as u32;
            positions.push(*place);
        }
    }
    let triangles = mesh.triangles.iter().filter(|t| piece(t) == largest);
    Mesh {
        positions,
        triangles: triangles.map(|t| t.map(|v| number[v as usize])).collect(),
    }
}

fn squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
}

impl MadeHead {
    /// Number of vertices of the skin.
    pub fn skin_vertices(&self) -> usize {
        self.objects.first().map_or(0, |(_, skin)| skin.len())
    }

    /// The mesh in metres as OBJ text, with its objects, materials and texture coordinates.
    pub fn to_obj(&self) -> String {
        let mut text = String::from(
            "# A head made by Anyface; metres, +x subject's left, +y up, +z forward\n",
        );
        for [u, v] in self.uv.as_flattened() {
            text += &format!("vt {u:.5} {v:.5}\n");
        }
        for (name, vertices) in &self.objects {
            text += &format!("o {name}\n");
            for [x, y, z] in &self.mesh.positions[vertices.clone()] {
                text += &format!("v {x:.6} {y:.6} {z:.6}\n");
            }
            let is_here = |face: &usize| vertices.contains(&(self.faces[*face][0] as usize));
            for (material, faces) in &self.materials {
                let mut faces = faces.clone().filter(is_here).peekable();
                if faces.peek().is_some() {
                    text += &format!("usemtl {material}\n");
                }
                faces.for_each(|face| text += &self.face_line(face));
            }
        }
        text
    }

    fn face_line(&self, face: usize) -> String {
        let corners = self.faces[face];
        let count = if corners[2] == corners[3] { 3 } else { 4 };
        let mut line = String::from("f");
        for (number, corner) in corners[..count].iter().enumerate() {
            line += &format!(" {}", corner + 1);
            if face < self.uv.len() {
                line += &format!("/{}", 4 * face + number + 1);
            }
        }
        line + "\n"
    }
}
