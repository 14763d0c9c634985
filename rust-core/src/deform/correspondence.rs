//! Finds the points of a reference face that each vertex of another face follows.
//!
//! To warp the reference onto the other face, the shift of the 68 landmarks is interpolated with
//! the radial basis `|r|` (Hardy 1971). A vertex then follows its nearest points, more if their
//! skin lies in its own plane and less if they are far from it. So the upper lip does not follow
//! the lower one, nor a cheek the gums.
//!
//! Lengths are decimetres in the canonical frame.

use faer::{Mat, linalg::solvers::Solve};
use glam::Vec3;
use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use crate::{face::nearest::PointGrid, mesh::ibug::LANDMARKS};

/// The most points that a vertex follows.
const NEIGHBOURS: usize = 4;
/// Added to distances, so that a point at distance 0 does not outweigh all others, decimetres.
const SOFT_DM: f32 = 0.003;
/// If its nearest point is no further than this, a vertex follows fully.
const FULL_WITHIN_DM: f32 = 0.06;
/// If its nearest point is this far or further, a vertex does not follow at all.
const GONE_AT_DM: f32 = 0.12;
const CELL_DM: f32 = 0.04;

/// Points on the surface of a reference face.
#[derive(Debug, Clone)]
pub struct ReferencePoints {
    /// `[P]`.
    pub points: Vec<[f32; 3]>,
    /// `[P]`, unit.
    pub normals: Vec<[f32; 3]>,
    /// Of the same face; no two are at the same place.
    pub landmarks: [[f32; 3]; LANDMARKS],
}

/// A face that is to follow a reference.
#[derive(Clone, Copy)]
pub struct FollowingFace<'a> {
    /// `[V]`.
    pub positions: &'a [[f32; 3]],
    /// Of these positions; the winding does not matter.
    pub triangles: &'a [[u32; 3]],
    /// Of the neutral face.
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
}

/// For each vertex of a face, the points that it follows and their shares. The shares sum to at most 1.
#[derive(Debug, Clone)]
pub struct Correspondence(Vec<Vec<(u32, f32)>>);

impl ReferencePoints {
    /// Two landmarks at the same place, if there are any. The interpolation fails for them.
    pub fn coinciding(&self) -> Option<[usize; 2]> {
        let all = self.landmarks.iter().enumerate();
        let mut pairs = all.filter_map(|(n, at)| {
            let other = self.landmarks[..n].iter().position(|other| other == at)?;
            Some([other, n])
        });
        pairs.next()
    }

    /// Finds the points that each vertex of `face` follows.
    pub fn carried_to(&self, face: FollowingFace<'_>) -> Correspondence {
        let planes = planes(face.positions, face.triangles);
        let points = self.warped(face.landmarks);
        let grid = PointGrid::new(&points, CELL_DM);
        let followed = |(v, &p): (usize, &[f32; 3])| {
            let near = grid.within(p, GONE_AT_DM, NEIGHBOURS);
            let weight = |&(p, distance): &(u32, f32)| {
                planes[v].along(self.normals[p as usize]) / (distance + SOFT_DM).powi(2)
            };
            let total: f32 = near.iter().map(weight).sum();
            if total <= 0.0 {
                return Vec::new();
            }
            let fade = (GONE_AT_DM - near[0].1) / (GONE_AT_DM - FULL_WITHIN_DM);
            let share = |neighbour: &(u32, f32)| fade.clamp(0.0, 1.0) * weight(neighbour) / total;
            near.iter()
                .map(|neighbour| (neighbour.0, share(neighbour)))
                .collect()
        };
        let positions = face.positions.par_iter().enumerate();
        Correspondence(positions.map(followed).collect())
    }

    /// The points, warped onto the face with these `landmarks`.
    pub(crate) fn warped(&self, landmarks: &[[f32; 3]; LANDMARKS]) -> Vec<[f32; 3]> {
        let size = LANDMARKS + 1;
        let radial = |a: [f32; 3], b: [f32; 3]| -f64::from(Vec3::from(a).distance(b.into()));
        let system = Mat::from_fn(size, size, |i, j| match (i < LANDMARKS, j < LANDMARKS) {
            (true, true) => radial(self.landmarks[i], self.landmarks[j]),
            (false, false) => 0.0,
            _ => 1.0,
        });
        let shift = Mat::from_fn(size, 3, |i, axis| {
            if i < LANDMARKS {
                f64::from(landmarks[i][axis] - self.landmarks[i][axis])
            } else {
                0.0
            }
        });
        let weights = system.partial_piv_lu().solve(&shift);
        let moved = |&point: &[f32; 3]| {
            let mut shift = [0, 1, 2].map(|axis| weights[(LANDMARKS, axis)]);
            for (n, &landmark) in self.landmarks.iter().enumerate() {
                let radial = radial(point, landmark);
                (0..3).for_each(|axis| shift[axis] += radial * weights[(n, axis)]);
            }
            std::array::from_fn(|axis| point[axis] + shift[axis] as f32)
        };
        self.points.par_iter().map(moved).collect()
    }
}

impl Correspondence {
    /// Transfers a field over the points, `[P, C]`, to the vertices, `[V, C]`.
    pub fn of(&self, field: ArrayView2<'_, f32>) -> Array2<f32> {
        let mut out = Array2::zeros((self.0.len(), field.ncols()));
        let rows = out.outer_iter_mut().into_par_iter().zip(&self.0);
        rows.for_each(|(mut row, followed)| {
            for &(point, share) in followed {
                row.scaled_add(share, &field.row(point as usize));
            }
        });
        out
    }
}

/// The planes of the triangles around a vertex, whatever their winding: `Σ n nᵀ`, where `n` is the
/// normal of a triangle, as long as twice its area. Holds the upper triangle of this matrix, row by
/// row.
#[derive(Debug, Clone, Copy, Default)]
struct Planes([f32; 6]);

impl Planes {
    fn add(&mut self, [x, y, z]: [f32; 3]) {
        let products = [x * x, x * y, x * z, y * y, y * z, z * z];
        self.0.iter_mut().zip(products).for_each(|(a, b)| *a += b);
    }

    /// Mean square of the cosine between the triangles' normals and a unit vector, 0 to 1.
    fn along(&self, [x, y, z]: [f32; 3]) -> f32 {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        let size = xx + yy + zz;
        let along = xx * x * x + yy * y * y + zz * z * z;
        let across = 2.0 * (xy * x * y + xz * x * z + yz * y * z);
        if size > 0.0 {
            ((along + across) / size).max(0.0)
        } else {
            0.0
        }
    }
}

fn planes(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<Planes> {
    let mut planes = vec![Planes::default(); positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let normal = (Vec3::from(b) - Vec3::from(a)).cross(Vec3::from(c) - Vec3::from(a));
        triangle
            .iter()
            .for_each(|&v| planes[v as usize].add(normal.into()));
    }
    planes
}
