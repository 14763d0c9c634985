//! The surface around a mouth, in the mouth's own frame.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::{
    Error, Result,
    mesh::{
        Landmarks, Mesh, Parts, Similarity,
        direction::unit,
        parts::{NO_PART, weld_seams},
    },
};

/// The patch reaches this far from the middle of the mouth, in widths of the mouth.
const REACH: f64 = 0.85;
/// Up and down it reaches this many times less far.
const FLATTER: f64 = 1.6;
/// Landmarks of the lips. The surface that holds most of them is the skin.
const LIPS: std::ops::Range<usize> = 48..68;

/// The frame of a mouth. Its unit of length is the distance between the inner corners.
pub(super) struct MouthFrame {
    /// The subject's right corner, mesh units.
    pub start: DVec3,
    /// Unit vectors: to the left corner, up, out of the face.
    pub axes: [DVec3; 3],
    /// Distance between the inner corners, mesh units.
    pub width: f64,
}

impl MouthFrame {
    /// Up is the mean of the head's up and the direction from the lower to the upper lip. Where the
    /// two disagree, it is the head's up alone.
    pub fn of(landmarks: &Landmarks, to_canonical: &Similarity) -> Result<MouthFrame> {
        let at = |n: usize| Vec3::from(landmarks.positions[n]).as_dvec3();
        let (start, way) = (at(60), at(64) - at(60));
        let (width, whole) = (way.length(), at(54).distance(at(48)));
        if !width.is_finite() || width < 0.3 * whole || whole <= 0.0 {
            return Err(Error::InvalidInput(format!(
                "landmarks 60 and 64: expected the inner corners of the mouth about as far apart as \
                 48 and 54 ({whole:.4}), got {width:.4}"
            )));
        }
        let across = unit(way);
        let upright = |v: DVec3| unit(v - v.dot(across) * across);
        let middle = |of: [usize; 3]| of.map(at).into_iter().sum::<DVec3>() / 3.0;
        let up = to_canonical.inverse().rotate([0.0, 1.0, 0.0]);
        let of_head = upright(Vec3::from(up).as_dvec3());
        let of_lips = upright(middle([50, 51, 52]) - middle([56, 57, 58]));
        let up = if of_head.dot(of_lips) > 0.3 {
            upright(of_head + of_lips)
        } else {
            of_head
        };
        Ok(MouthFrame {
            start,
            axes: [across, up, across.cross(up)],
            width,
        })
    }

    /// Across, up and out, in widths of the mouth from its right corner.
    pub fn local(&self, p: DVec3) -> DVec3 {
        let offset = p - self.start;
        (self.axes.map(|axis| axis.dot(offset) / self.width)).into()
    }

    /// [`MouthFrame::local`] of a point in single precision.
    pub fn local_of(&self, p: [f32; 3]) -> DVec3 {
        self.local(Vec3::from(p).as_dvec3())
    }

    /// The point of the mesh that has these local coordinates.
    pub fn point(&self, local: DVec3) -> DVec3 {
        let [across, up, out] = self.axes;
        self.start + self.width * (across * local.x + up * local.y + out * local.z)
    }
}

/// Which vertices at the same place count as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sewing {
    /// Only vertices along texture seams.
    Seams,
    /// All of them. Where hard edges and corners of several textures meet, seams cannot be told
    /// from rims.
    Places,
}

/// The skin around a mouth, its texture seams sewn up.
pub(super) struct Patch {
    /// `[F']`, numbers of its triangles in the mesh.
    pub faces: Vec<u32>,
    /// `[F', 3]`, indices into `points`.
    pub triangles: Vec<[u32; 3]>,
    /// `[P, 3]`, in the mouth's frame.
    pub points: Vec<DVec3>,
}

impl Patch {
    /// # Errors
    /// `Mesh` where no landmark of the lips lies on a surface.
    pub fn around(
        mesh: &Mesh,
        landmarks: &Landmarks,
        frame: &MouthFrame,
        sewing: Sewing,
    ) -> Result<Patch> {
        let local: Vec<DVec3> = (0..mesh.positions.len() as u32)
            .map(|v| frame.local(mesh.point(v)))
            .collect();
        let near = |v: u32| {
            let DVec3 { x, y, z } = local[v as usize];
            DVec3::new(x - 0.5, FLATTER * y, z).length() < REACH
        };
        let faces: Vec<u32> = (0..mesh.triangles.len() as u32)
            .filter(|&f| mesh.triangles[f as usize].iter().any(|&v| near(v)))
            .collect();
        let triangles: Vec<[u32; 3]> = faces.iter().map(|&f| mesh.triangles[f as usize]).collect();
        let sewn = match sewing {
            Sewing::Seams => weld_seams(&mesh.positions, &triangles, &[]),
            Sewing::Places => same_places(&mesh.positions, &triangles),
        };
        let sewn_triangles = triangles.iter().map(|t| t.map(|v| sewn[v as usize]));
        let sewn_triangles: Vec<[u32; 3]> = sewn_triangles.collect();
        let parts = Parts::of(mesh.positions.len(), &sewn_triangles);
        let skin = most_landmarks(&parts, &sewn, landmarks)?;
        let mut numbers = HashMap::new();
        let mut patch = Patch {
            faces: Vec::new(),
            triangles: Vec::new(),
            points: Vec::new(),
        };
        for (&face, t) in faces.iter().zip(&sewn_triangles) {
            if parts.of_vertex[t[0] as usize] != skin
                || t[0] == t[1]
                || t[1] == t[2]
                || t[2] == t[0]
            {
                continue;
            }
            patch.faces.push(face);
            patch.triangles.push(t.map(|v| {
                *numbers.entry(v).or_insert_with(|| {
                    patch.points.push(local[v as usize]);
                    patch.points.len() as u32 - 1
                })
            }));
        }
        Ok(patch)
    }

    /// Longest edge of the triangle nearest to a point of the mouth's frame, in widths.
    pub fn edge_near(&self, p: DVec3) -> f64 {
        let length = |t: &[u32; 3]| -> f64 {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            let sides = [a - b, b - c, c - a].map(DVec3::length);
            sides.into_iter().fold(0.0, f64::max)
        };
        let away = |t: &[u32; 3]| -> f64 {
            let corners = t.map(|v| self.points[v as usize].distance(p));
            corners.into_iter().fold(f64::INFINITY, f64::min)
        };
        let nearest = self
            .triangles
            .iter()
            .min_by(|a, b| away(a).total_cmp(&away(b)));
        nearest.map_or(0.0, length)
    }
}

/// `[V]`: for each corner of these triangles, the first corner at the same place. Every other
/// vertex stands for itself.
fn same_places(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut used: Vec<u32> = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    let mut sewn: Vec<u32> = (0..positions.len() as u32).collect();
    let mut first = HashMap::new();
    for v in used {
        // Adding zero turns −0 into 0, so that both are one place.
        let place = positions[v as usize].map(|x| (x + 0.0).to_bits());
        sewn[v as usize] = *first.entry(place).or_insert(v);
    }
    sewn
}

/// The part that holds the most landmarks of the lips.
fn most_landmarks(parts: &Parts, sewn: &[u32], landmarks: &Landmarks) -> Result<u32> {
    let mut counts = vec![0; parts.count];
    for n in LIPS {
        let part = parts.of_vertex[sewn[landmarks.vertices[n] as usize] as usize];
        if part != NO_PART {
            counts[part as usize] += 1;
        }
    }
    let most = (0..parts.count).max_by_key(|&part| (counts[part], std::cmp::Reverse(part)));
    match most.filter(|&part| counts[part] > 0) {
        Some(part) => Ok(part as u32),
        None => Err(Error::Mesh(
            "expected landmarks of the lips on a surface, got none".into(),
        )),
    }
}
