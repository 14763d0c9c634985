//! A head as a mesh: its surface once, in the canonical pose, and then the way to the face at rest.

use std::{ops::Range, sync::OnceLock};

use super::{OneHead, SURFACE_CELLS, parts};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    mesh::{Landmarks, Mesh, Parts, ibug::LANDMARKS},
    sdf::{Grid, surface},
};

/// How a head is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadOptions {
    /// Cells along the longest side of the grid.
    pub resolution: usize,
    /// Whether it gets eyes, teeth and a tongue: those of the default head.
    pub parts: bool,
}

impl Default for HeadOptions {
    fn default() -> Self {
        HeadOptions {
            resolution: 128,
            parts: true,
        }
    }
}

/// A head as a mesh at rest, metres: +x to the subject's left, +y up, +z out of the face.
#[derive(Debug, Clone, PartialEq)]
pub struct MadeHead {
    /// The skin, then the parts.
    pub mesh: Mesh,
    /// On vertices of the skin.
    pub landmarks: Landmarks,
    /// The skin's vertices in the canonical pose; the mesh begins with the same ones at rest.
    pub canonical: Vec<[f32; 3]>,
    /// Names of the objects and their vertices.
    pub objects: Vec<(String, Range<usize>)>,
    /// Names of materials and their triangles.
    pub materials: Vec<(String, Range<usize>)>,
}

impl OneHead<'_> {
    /// Makes the mesh of this head.
    ///
    /// # Errors
    /// `InvalidInput` for a resolution under 32, above 4096 or that would take more than 1 GiB, and for a code
    /// without a surface; `Cancelled`.
    pub fn mesh(&self, options: &HeadOptions, progress: ProgressFn<'_>) -> Result<MadeHead> {
        let least = *SURFACE_CELLS.start();
        if options.resolution < least {
            return Err(Error::InvalidInput(format!(
                "resolution: expected at least {least} cells along the longest side, as fewer leave no face, got {}",
                options.resolution
            )));
        }
        let skin = self.canonical_surface(options.resolution, progress)?;
        let Mesh {
            positions: mut canonical,
            triangles,
        } = skin;
        let vertices = self.put_on_vertices(&mut canonical);
        let mover = self.mover(canonical.clone());
        report(progress, "rest", 0.0)?;
        let positions = mover.at(&self.head.rest_code())?;
        let places = vertices.map(|v| positions[v as usize]);
        let mut made = MadeHead {
            landmarks: Landmarks {
                positions: places,
                vertices,
                confidence: [1.0; LANDMARKS],
            },
            canonical,
            objects: vec![("skin".to_owned(), 0..positions.len())],
            materials: vec![("skin".to_owned(), 0..triangles.len())],
            mesh: Mesh {
                positions,
                triangles,
            },
        };
        if options.parts {
            made.add_parts();
        }
        report(progress, "rest", 1.0)?;
        Ok(made)
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
        let made = surface(grid, |points| {
            if let Err(error) = report(progress, "surface", 0.5) {
                let _ = stopped.set(error);
                return vec![f32::NAN; points.nrows()];
            }
            let points: Vec<[f32; 3]> = points.outer_iter().map(|p| [p[0], p[1], p[2]]).collect();
            self.distance(&points)
        });
        match stopped.into_inner() {
            Some(error) => Err(error),
            None => made.map(|mesh| largest_piece(&mesh)),
        }
    }

    /// Moves the vertex nearest to each landmark onto it; their numbers.
    fn put_on_vertices(&self, vertices: &mut [[f32; 3]]) -> [u32; LANDMARKS] {
        let places = self.on_surface(self.landmarks());
        let mut taken = [u32::MAX; LANDMARKS];
        for (number, place) in places.into_iter().enumerate() {
            let free = (0..vertices.len() as u32).filter(|v| !taken[..number].contains(v));
            let nearest = free.min_by(|a, b| {
                let [a, b] = [a, b].map(|v| squared(vertices[*v as usize], place));
                a.total_cmp(&b)
            });
            if let Some(vertex) = nearest {
                vertices[vertex as usize] = place;
                taken[number] = vertex;
            }
        }
        taken
    }

    /// Canonical points near the surface, on it: three of Newton's steps along the gradient.
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

/// The connected piece with most triangles: a field that was learned has specks of surface beside a head.
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
    let kept = mesh.triangles.iter().filter(|t| piece(t) == largest);
    Mesh {
        positions,
        triangles: kept.map(|t| t.map(|v| number[v as usize])).collect(),
    }
}

fn squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
}

impl MadeHead {
    fn add_parts(&mut self) {
        for (part, places) in parts::placed(&self.landmarks.positions) {
            let (vertices, triangles) = (self.mesh.positions.len(), self.mesh.triangles.len());
            self.objects
                .push((part.name.clone(), vertices..vertices + places.len()));
            self.mesh.positions.extend(places);
            let moved = part
                .triangles
                .iter()
                .map(|t| t.map(|v| v + vertices as u32));
            self.mesh.triangles.extend(moved);
            let materials = part.materials.iter();
            self.materials.extend(materials.map(|(name, range)| {
                (name.clone(), triangles + range.start..triangles + range.end)
            }));
        }
    }

    /// The mesh as an OBJ with its objects and materials, metres.
    pub fn to_obj(&self) -> String {
        let mut text = String::from(
            "# A head made by Anyface; metres, +x subject's left, +y up, +z forward\n",
        );
        for (name, vertices) in &self.objects {
            text += &format!("o {name}\n");
            for [x, y, z] in &self.mesh.positions[vertices.clone()] {
                text += &format!("v {x:.6} {y:.6} {z:.6}\n");
            }
            for (material, triangles) in &self.materials {
                let triangles = &self.mesh.triangles[triangles.clone()];
                if triangles
                    .first()
                    .is_some_and(|t| vertices.contains(&(t[0] as usize)))
                {
                    text += &format!("usemtl {material}\n");
                    for [a, b, c] in triangles {
                        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
                    }
                }
            }
        }
        text
    }
}
