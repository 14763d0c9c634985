//! Sews the surfaces behind the rim of lids that were cut open: the lining of the lids and the rest
//! of the eyeball.
//!
//! Both consist of rows of vertices that start at the rim and curve around the centre of the ball.
//! The rows of the lining lead away from the eye. The rows of the ball lie just below them and lead
//! on to its back. Both surfaces stay behind the visible skin.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::{rim::depth, space::EyeSpace, split::RimPlace};
use crate::{
    face::opened::{FineMesh, TriangleSource},
    mesh::FrontView,
};

/// Distances of the rows of the lining from the rim, in widths of the eye (the last at 8 mm).
const LINING: [f32; 4] = [0.03, 0.08, 0.16, 0.28];
/// Where the rows of the ball lie, as shares of the angle from the rim to the ball's back.
const BALL: [f32; 6] = [0.03, 0.1, 0.22, 0.4, 0.6, 0.8];
/// How far the ball lies below the lining, in widths (0.4 mm).
const BELOW: f32 = 0.015;
/// How far the lining lies behind the skin, in widths (0.5 mm).
const BEHIND: f32 = 0.02;
/// Passes of a binomial filter over the directions away from the eye.
const SMOOTHING: usize = 8;

/// New triangles behind the rim of an eye, and their sources.
#[derive(Default)]
pub(super) struct Behind {
    pub triangles: Vec<[u32; 3]>,
    pub sources: Vec<TriangleSource>,
}

/// An eye that was cut free.
pub(super) struct Socket<'a> {
    pub space: &'a EyeSpace,
    /// Radius of the ball, centimetres.
    pub radius: f32,
    /// Distance from corner to corner, centimetres.
    pub width: f32,
    /// The skin, seen from the front.
    pub skin: &'a FrontView,
    pub line: &'a [RimPlace],
}

impl Socket<'_> {
    /// Adds the vertices behind the rim and returns the faces between them.
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

    /// Moves a place back where it does not lie at least `behind` widths behind the skin.
    fn under_skin(&self, p: Vec3, behind: f32) -> Vec3 {
        let skin = depth(self.skin, p.truncate());
        if skin.is_finite() {
            p.truncate().extend(p.z.min(skin - behind * self.width))
        } else {
            p
        }
    }

    /// Adds vertices with the same sources as the vertices at the rim.
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

    /// Adds the faces between two rows. Those of the ball wind the other way round.
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
            let faces = if is_ball {
                [[row[j], row[i], next[i]], [row[j], next[i], next[j]]]
            } else {
                [[row[i], row[j], next[j]], [row[i], next[j], next[i]]]
            };
            behind.triangles.extend(faces);
            behind.sources.extend([source(place); 2]);
        }
    }
}

/// The direction that leads away from the eye at each place of its rim, seen from the front.
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
