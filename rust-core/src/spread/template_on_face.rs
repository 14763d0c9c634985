//! The vertices of a template on the mesh of a face: what follows its surface, and how far.
//!
//! The template is bent onto the face as [`ReferencePoints`] are, by its landmarks. Every row of the skin takes what the
//! nearest place of that surface that faces the same way does; less the farther it lies from it, where the template ends,
//! and about lips and lids, which keep to their landmarks.

use glam::Vec3;
use ndarray::{Array3, ArrayView3, Axis};
use rayon::prelude::*;

use crate::{
    Result,
    deform::{ReferencePoints, fade},
    face::Face,
    mesh::{
        Mesh, Similarity, SurfaceTree, ibug::LANDMARKS, parts::boundary_edges,
        tree::closest_weights,
    },
    motion::Template,
};

const CM_PER_M: f32 = 100.0;
/// Nearer to the template's surface than the first a row follows wholly, farther than the second not at all;
/// centimetres, as everywhere below.
const NEAR_CM: (f32, f32) = (1.0, 2.0);
/// The same for where the template ends, and for lips and lids, where nothing follows nearer than the first.
const BORDER_CM: (f32, f32) = (0.0, 0.5);
const LIPS_CM: (f32, f32) = (0.2, 1.0);
const LIDS_CM: (f32, f32) = (0.2, 0.8);
/// Cosine between the normals of a row and of the triangle that it follows, at least.
const SAME_WAY: f32 = 0.2;

/// What the vertices of one face take from those of a template.
pub struct TemplateOnFace {
    to_canonical: Similarity,
    landmarks: [usize; LANDMARKS],
    /// `[V]`, vertices of the template and by which shares each is followed.
    followed: Vec<Vec<(u32, f32)>>,
    /// `[V]`, by which share the template is followed, 0 to 1.
    shares: Vec<f32>,
}

/// Where a row of the skin lies on the template.
struct Place {
    corners: [u32; 3],
    weights: [f32; 3],
    share: f32,
}

impl TemplateOnFace {
    /// Lays the template on a face. `share`: how far vertices follow it at most, 0 to 1.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face.
    pub fn new(face: &Face, template: &Template, share: f32) -> Result<TemplateOnFace> {
        let surface = face.surface()?;
        let bent = Bent::new(template, &surface.landmarks);
        let operators = &surface.skin.operators;
        let rows = Mesh {
            positions: (operators.positions.iter().map(|p| p.as_vec3().into())).collect(),
            triangles: operators.triangles.clone(),
        };
        let places = bent.places(&rows, &surface.landmarks);
        let mut row_shares: Vec<f32> = places.iter().map(|place| place.share).collect();
        let all: Vec<u32> = (0..row_shares.len() as u32).collect();
        fade::even_out(&mut row_shares, &rows.triangles, &all);
        let of_vertex = |v: usize| {
            let (mut followed, mut felt, mut whole) = (Vec::new(), 0.0, 0.0);
            for (row, by) in surface.rows_followed(v) {
                let (place, by_row) = (&places[row], by * share * row_shares[row]);
                whole += by;
                felt += by_row;
                let corners = place.corners.iter().zip(place.weights);
                followed.extend(corners.map(|(&corner, weight)| (corner, by_row * weight)));
            }
            match felt > 0.0 {
                true => (followed, felt / whole),
                false => (Vec::new(), 0.0),
            }
        };
        let vertices = 0..face.mesh.positions.len();
        let (followed, shares) = vertices.into_par_iter().map(of_vertex).unzip();
        Ok(TemplateOnFace {
            to_canonical: face.to_canonical,
            landmarks: template.landmarks,
            followed,
            shares,
        })
    }

    /// By which share each vertex `[V]` follows the template.
    pub fn shares(&self) -> &[f32] {
        &self.shares
    }

    /// The template's landmarks under `motion` `[t, V', 3]` of it: `[t, 68, 3]`.
    pub fn landmarks(&self, motion: ArrayView3<'_, f32>) -> Array3<f32> {
        motion.select(Axis(1), &self.landmarks)
    }

    /// What is to be added to `base` `[t, V, 3]`, motion of the mesh, so that vertices that follow the template move
    /// as it does under `motion` `[t, V', 3]`, canonical metres: `[t, V, 3]`, mesh units and axes.
    pub fn beyond(&self, motion: ArrayView3<'_, f32>, base: &Array3<f32>) -> Array3<f32> {
        let own = self.to_canonical.displacements_to_mesh(motion);
        let mut out = Array3::zeros(base.dim());
        let frames = out.axis_iter_mut(Axis(0)).into_par_iter();
        let made = own.axis_iter(Axis(0)).into_par_iter();
        let bases = base.axis_iter(Axis(0)).into_par_iter();
        frames
            .zip(made.zip(bases))
            .for_each(|(mut out, (own, base))| {
                for (v, followed) in self.followed.iter().enumerate() {
                    let mut row = out.row_mut(v);
                    for &(corner, share) in followed {
                        row.scaled_add(share, &own.row(corner as usize));
                    }
                    row.scaled_add(-self.shares[v], &base.row(v));
                }
            });
        out
    }
}

/// The template bent onto a face, canonical centimetres, and what is needed to find places on it.
struct Bent {
    mesh: Mesh,
    /// Of each triangle, twice the area times the unit normal.
    facing: Vec<Vec3>,
    /// Where it ends, lips and lids too.
    border: Vec<[f32; 3]>,
}

impl Bent {
    fn new(template: &Template, landmarks: &[[f32; 3]; LANDMARKS]) -> Bent {
        let cm = |p: [f32; 3]| p.map(|x| CM_PER_M * x);
        let own = ReferencePoints {
            points: template.mesh.positions.iter().map(|&p| cm(p)).collect(),
            normals: Vec::new(),
            landmarks: template.landmark_positions().map(cm),
        };
        let mesh = Mesh {
            positions: own.warped(landmarks),
            triangles: template.mesh.triangles.clone(),
        };
        let ends = boundary_edges(&mesh.triangles);
        let mut ends: Vec<u32> = ends.iter().flat_map(|&(a, b)| [a, b]).collect();
        ends.sort_unstable();
        ends.dedup();
        let facing = mesh.face_area_vectors();
        Bent {
            facing: facing.iter().map(|n| n.as_vec3()).collect(),
            border: ends.iter().map(|&v| mesh.positions[v as usize]).collect(),
            mesh,
        }
    }

    /// Places of the `rows` of a skin, `[R]`, of a face with these landmarks.
    fn places(&self, rows: &Mesh, landmarks: &[[f32; 3]; LANDMARKS]) -> Vec<Place> {
        let normals = rows.vertex_normals();
        let tree = SurfaceTree::new(&self.mesh);
        let place = |side: f32, row: usize| {
            let same = |n: usize| {
                let facing = self.facing[n];
                side * facing.dot(normals[row].into()) > SAME_WAY * facing.length()
            };
            let p = rows.positions[row];
            let found = tree.closest_where(p, same)?;
            let (lids, lips) = (&landmarks[36..48], &landmarks[48..]);
            let share = fade::within(found.distance, NEAR_CM)
                * fade::beyond(&self.border, found.position, BORDER_CM)
                * fade::beyond(lids, p, LIDS_CM)
                * fade::beyond(lips, p, LIPS_CM);
            let corners = self.mesh.triangles[found.triangle];
            let at = corners.map(|v| self.mesh.point(v));
            let weights = closest_weights(Vec3::from(found.position).as_dvec3(), at);
            Some(Place {
                corners,
                weights: weights.map(|w| w as f32),
                share,
            })
        };
        let all = |side: f32| -> Vec<Option<Place>> {
            let numbers = (0..rows.positions.len()).into_par_iter();
            numbers.map(|row| place(side, row)).collect()
        };
        // Triangles of a mesh may be turned inside out.
        let (out, inside_out) = (all(1.0), all(-1.0));
        let sum = |places: &[Option<Place>]| places.iter().flatten().map(|p| p.share).sum::<f32>();
        let better = match sum(&out) >= sum(&inside_out) {
            true => out,
            false => inside_out,
        };
        let nowhere = || Place {
            corners: [0; 3],
            weights: [0.0; 3],
            share: 0.0,
        };
        better
            .into_iter()
            .map(|p| p.unwrap_or_else(nowhere))
            .collect()
    }
}
