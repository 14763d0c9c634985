//! What lies behind the rim of lids that were cut open: their lining, and the rest of the eyeball.
//!
//! Rows of vertices go on from the rim, away from the eye and around the centre of its ball: those of the lining just
//! over it, those of the ball just below and on to its back. Both stay behind the skin that is seen.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::{rim::depth, space::EyeSpace, split::RimPlace};
use crate::{
    face::opened::{FineMesh, TriangleSource},
    mesh::FrontView,
};

/// How far beside the rim the rows of the lining lie, in widths of the eye (the last at 8 mm).
const LINING: [f32; 4] = [0.03, 0.08, 0.16, 0.28];
/// Where the rows of the ball lie on the way from the rim to its back.
const BALL: [f32; 6] = [0.03, 0.1, 0.22, 0.4, 0.6, 0.8];
/// How far the ball lies below the lining, and the lining behind the skin, in widths (.4 and .5 mm).
const BELOW: f32 = 0.015;
const BEHIND: f32 = 0.02;
/// Passes of a binomial filter over the directions away from the eye.
const SMOOTHING: usize = 8;

/// New triangles behind an eye's rim, and what they are made of.
#[derive(Default)]
pub(super) struct Behind {
    pub triangles: Vec<[u32; 3]>,
    pub sources: Vec<TriangleSource>,
}

/// An eye that was cut free.
pub(super) struct Socket<'a> {
    pub space: &'a EyeSpace,
    /// Of the ball, and from corner to corner; centimetres.
    pub radius: f32,
    pub width: f32,
    /// The skin, seen from the front.
    pub skin: &'a FrontView,
    pub line: &'a [RimPlace],
}

impl Socket<'_> {
    /// Adds the vertices behind the rim and returns its faces.
    pub fn sew(&self, fine: &mut FineMesh) -> Behind {
        let rim: Vec<Vec3> = (self.line.iter())
            .map(|place| self.space.local(fine.mesh.positions[place.lid as usize]))
            .collect();
        let away = directions(&rim);
        let mut behind = Behind::default();
        let mut row: Vec<u32> = self.line.iter().map(|place| place.lid).collect();
        for beside in LINING {
            let places = rim.iter().zip(&away).map(|(p, away)| {
                let length = p.length();
                let way = (*p + beside * self.width * away.extend(0.0)).normalize();
                self.under_skin(length * way, BEHIND * (beside / LINING[1]).min(1.0))
            });
            let next = self.add(fine, places, |place| place.lid);
            self.sew_row(&mut behind, &row, &next, |place| place.lid_source, false);
            row = next;
        }
        let mut row: Vec<u32> = self.line.iter().map(|place| place.eye).collect();
        for part in BALL {
            let places = rim.iter().map(|p| {
                let (polar, length) = (p.truncate().length().atan2(p.z), p.length());
                let angle = polar + part * (PI - polar);
                let across = p.truncate().normalize_or(Vec2::Y);
                let radius = length + (self.radius - length) * (4.0 * part).min(1.0);
                let way = (across * angle.sin()).extend(angle.cos());
                let below = BELOW * self.width * (part / BALL[1]).min(1.0);
                self.under_skin(
                    (radius - below) * way,
                    2.0 * BEHIND * (part / BALL[1]).min(1.0),
                )
            });
            let next = self.add(fine, places, |place| place.eye);
            self.sew_row(&mut behind, &row, &next, |place| place.eye_source, true);
            row = next;
        }
        let pole = self.add(fine, std::iter::once(-self.radius * Vec3::Z), |place| {
            place.eye
        })[0];
        for (i, place) in self.line.iter().enumerate() {
            let next = row[(i + 1) % row.len()];
            behind.triangles.push([next, row[i], pole]);
            behind.sources.push(place.eye_source);
        }
        behind
    }

    /// A place no nearer to the front than so many widths behind the skin.
    fn under_skin(&self, p: Vec3, behind: f32) -> Vec3 {
        let skin = depth(self.skin, p.truncate());
        match skin.is_finite() {
            true => p.truncate().extend(p.z.min(skin - behind * self.width)),
            false => p,
        }
    }

    /// New vertices, made of what those at the rim are.
    fn add(
        &self,
        fine: &mut FineMesh,
        places: impl Iterator<Item = Vec3>,
        like: impl Fn(&RimPlace) -> u32,
    ) -> Vec<u32> {
        let add = |(place, rim): (Vec3, &RimPlace)| {
            fine.mesh.positions.push(self.space.point(place));
            fine.vertex_sources
                .push(fine.vertex_sources[like(rim) as usize]);
            fine.mesh.positions.len() as u32 - 1
        };
        places.zip(self.line).map(add).collect()
    }

    /// Faces between two rows; those of the ball run the other way round.
    fn sew_row(
        &self,
        behind: &mut Behind,
        row: &[u32],
        next: &[u32],
        source: impl Fn(&RimPlace) -> TriangleSource,
        is_ball: bool,
    ) {
        for (i, place) in self.line.iter().enumerate() {
            let j = (i + 1) % row.len();
            let faces = match is_ball {
                false => [[row[i], row[j], next[j]], [row[i], next[j], next[i]]],
                true => [[row[j], row[i], next[i]], [row[j], next[i], next[j]]],
            };
            behind.triangles.extend(faces);
            behind.sources.extend([source(place); 2]);
        }
    }
}

/// Seen from the front: which way leads away from the eye at each place of its rim.
fn directions(rim: &[Vec3]) -> Vec<Vec2> {
    let count = rim.len();
    let at = |i: usize| rim[i % count].truncate();
    let area: f32 = (0..count).map(|i| at(i).perp_dot(at(i + 1))).sum();
    let mut away: Vec<Vec2> = (0..count)
        .map(|i| {
            let along = at(i + 1) - at(i + count - 1);
            (-along.perp() * area.signum()).normalize_or_zero()
        })
        .collect();
    for _ in 0..SMOOTHING {
        let old = away.clone();
        for i in 0..count {
            away[i] =
                0.25 * old[(i + count - 1) % count] + 0.5 * old[i] + 0.25 * old[(i + 1) % count];
        }
    }
    away.iter().map(|way| way.normalize_or_zero()).collect()
}
