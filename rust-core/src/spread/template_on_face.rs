//! Lays a template on a face: finds which vertices follow its surface, and by which share.
//!
//! The landmarks bend the template onto the face, as they do with [`ReferencePoints`]. Every row of
//! the skin follows the nearest place of the bent surface that faces the same way. A row follows
//! less if it lies far from that place or near the border of the template. It also follows less
//! near the lips and the lids, because these follow their landmarks.

use std::ops::Range;

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
/// A row within the first distance of the template's surface follows it wholly. Beyond the second
/// distance it does not follow at all. All lengths are centimetres.
const NEAR_CM: (f32, f32) = (1.0, 2.0);
/// Within the first distance of the template's border, the lips or the lids, rows do not follow.
/// Beyond the second distance they follow wholly.
const BORDER_CM: (f32, f32) = (0.0, 0.5);
const LIPS_CM: (f32, f32) = (0.2, 1.0);
const LIDS_CM: (f32, f32) = (0.2, 0.8);
/// Loops of landmarks around the outer and the inner lips, and points of the lips from one landmark to
/// the next. Skin between two landmarks of a lip is as near to it as skin at them.
const LIP_LOOPS: [Range<usize>; 2] = [48..60, 60..68];
const POINTS_BETWEEN: usize = 5;
/// The normals of a row and of the triangle that it follows have a cosine greater than this.
const SAME_WAY: f32 = 0.2;

/// How the vertices of one face follow those of a template.
pub struct TemplateOnFace {
    to_canonical: Similarity,
    landmarks: [usize; LANDMARKS],
    /// `[V]`, the vertices of the template that each vertex follows, with their shares.
    followed: Vec<Vec<(u32, f32)>>,
    /// `[V]`, the share by which each vertex follows the template, 0 to 1.
    shares: Vec<f32>,
}

/// Where a row of the skin lies on the template.
struct Place {
    corners: [u32; 3],
    weights: [f32; 3],
    share: f32,
}

impl TemplateOnFace {
    /// Lays the template on a face. `share`: the most by which a vertex follows it, 0 to 1.
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
            let (mut followed, mut share_sum, mut total) = (Vec::new(), 0.0, 0.0);
            for (row, by) in surface.rows_followed(v) {
                let (place, by_row) = (&places[row], by * share * row_shares[row]);
                total += by;
                share_sum += by_row;
                let corners = place.corners.iter().zip(place.weights);
                followed.extend(corners.map(|(&corner, weight)| (corner, by_row * weight)));
            }
            if share_sum > 0.0 {
                (followed, share_sum / total)
            } else {
                (Vec::new(), 0.0)
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

    /// The share by which each vertex `[V]` follows the template.
    pub fn shares(&self) -> &[f32] {
        &self.shares
    }

    /// Displacements of the template's landmarks, `[t, 68, 3]`, when its vertices move by `motion`
    /// `[t, V', 3]`.
    pub fn landmarks(&self, motion: ArrayView3<'_, f32>) -> Array3<f32> {
        motion.select(Axis(1), &self.landmarks)
    }

    /// What to add to the motion `base` `[t, V, 3]` of the mesh, so that the vertices follow the
    /// template when it moves by `motion` `[t, V', 3]`, canonical metres. Returns `[t, V, 3]`, mesh
    /// units and axes.
    pub fn beyond(&self, motion: ArrayView3<'_, f32>, base: &Array3<f32>) -> Array3<f32> {
        let motion = self.to_canonical.displacements_to_mesh(motion);
        let mut out = Array3::zeros(base.dim());
        let frames = out.axis_iter_mut(Axis(0)).into_par_iter();
        let moved = motion.axis_iter(Axis(0)).into_par_iter();
        let bases = base.axis_iter(Axis(0)).into_par_iter();
        frames
            .zip(moved.zip(bases))
            .for_each(|(mut out, (motion, base))| {
                for (v, followed) in self.followed.iter().enumerate() {
                    let mut row = out.row_mut(v);
                    for &(corner, share) in followed {
                        row.scaled_add(share, &motion.row(corner as usize));
                    }
                    row.scaled_add(-self.shares[v], &base.row(v));
                }
            });
        out
    }
}

/// The template bent onto a face, canonical centimetres, with data for finding places on it.
struct Bent {
    mesh: Mesh,
    /// For each triangle, twice its area times its unit normal.
    facing: Vec<Vec3>,
    /// Vertices on the open edges of the template, including those at lips and lids.
    border: Vec<[f32; 3]>,
}

impl Bent {
    fn new(template: &Template, landmarks: &[[f32; 3]; LANDMARKS]) -> Bent {
        let cm = |p: [f32; 3]| p.map(|x| CM_PER_M * x);
        let reference = ReferencePoints {
            points: template.mesh.positions.iter().map(|&p| cm(p)).collect(),
            normals: Vec::new(),
            landmarks: template.landmark_positions().map(cm),
        };
        let mesh = Mesh {
            positions: reference.warped(landmarks),
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

    /// Finds the places `[R]` of the `rows` of a face's skin. `landmarks`: those of the face.
    fn places(&self, rows: &Mesh, landmarks: &[[f32; 3]; LANDMARKS]) -> Vec<Place> {
        let normals = rows.vertex_normals();
        let tree = SurfaceTree::new(&self.mesh);
        let (lids, lips) = (&landmarks[36..48], lip_lines(landmarks));
        let place = |side: f32, row: usize| {
            let same = |n: usize| {
                let facing = self.facing[n];
                side * facing.dot(normals[row].into()) > SAME_WAY * facing.length()
            };
            let p = rows.positions[row];
            let closest = tree.closest_where(p, same)?;
            let share = fade::within(closest.distance, NEAR_CM)
                * fade::beyond(&self.border, closest.position, BORDER_CM)
                * fade::beyond(lids, p, LIDS_CM)
                * fade::beyond(&lips, p, LIPS_CM);
            let corners = self.mesh.triangles[closest.triangle];
            let at = corners.map(|v| self.mesh.point(v));
            let weights = closest_weights(Vec3::from(closest.position).as_dvec3(), at);
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
        // The triangles of a mesh may be inside out. Keep the side on which more follows.
        let (out, inside_out) = (all(1.0), all(-1.0));
        let sum = |places: &[Option<Place>]| places.iter().flatten().map(|p| p.share).sum::<f32>();
        let better = if sum(&out) >= sum(&inside_out) {
            out
        } else {
            inside_out
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

/// Points along the lines through the landmarks of the lips.
fn lip_lines(landmarks: &[[f32; 3]; LANDMARKS]) -> Vec<[f32; 3]> {
    let mut points = Vec::new();
    for lips in LIP_LOOPS {
        for n in lips.clone() {
            let next = if n + 1 == lips.end { lips.start } else { n + 1 };
            let [from, to] = [n, next].map(|n| Vec3::from(landmarks[n]));
            points.extend((0..POINTS_BETWEEN).map(|k| {
                let along = k as f32 / POINTS_BETWEEN as f32;
                from.lerp(to, along).to_array()
            }));
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    #[test]
    fn a_lip_is_near_between_its_landmarks_too() {
        let landmarks = canonical_landmarks().map(|p| p.map(|x| CM_PER_M * x));
        let lines = lip_lines(&landmarks);
        assert!((48..68).all(|n| lines.contains(&landmarks[n])));
        for (a, b) in [(61, 62), (66, 67), (57, 58), (67, 60), (59, 48)] {
            let between = Vec3::from(landmarks[a]).midpoint(landmarks[b].into());
            let share = fade::beyond(&lines, between.into(), LIPS_CM);
            assert!(share < 0.05, "{a} {b}: {share}");
        }
    }
}
