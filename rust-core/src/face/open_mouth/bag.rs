//! The inside of a mouth: a bag sewn behind the parted lips.
//!
//! Each lip first rolls inward: an arc starts at the slit in the direction of the lip's own front
//! and turns until it leads straight back. So a flat lip, such as a painted one, gets a round edge,
//! and a lip whose front already leads into a valley hardly bends. At rest each arc lies behind the
//! front of the other lip. Behind the lips the bag widens up and down, and it closes at the throat.
//! Each ring has one vertex for each vertex of the slit.

use std::{
    f64::consts::FRAC_PI_2,
    ops::{Add, Mul},
};

use glam::{DVec2, DVec3};

use super::{cut::CutMesh, patch::MouthFrame};
use crate::mesh::Mesh;

/// Depth of the bag, in widths of the mouth (40 mm).
const DEPTH: f64 = 0.8;
/// The least depth, where the head is thin, in widths.
const LEAST_DEPTH: f64 = 0.15;
/// The bag reaches at most this share of the way to the next surface behind the lips.
const SHARE_OF_HEAD: f64 = 0.5;
/// A surface that lies less than this behind the slit belongs to the lips, in widths.
const LIPS: f64 = 0.12;
/// Depths of the rings behind the lips, as shares of the bag's depth.
const RINGS: [f64; 7] = [0.05, 0.13, 0.23, 0.36, 0.53, 0.75, 1.0];
/// Height of the bag above and below the slit, in widths (11 mm).
const HEIGHT: f64 = 0.22;
/// Depth of the bag at the corners, as a share of its depth in the middle.
const DEPTH_AT_CORNERS: f64 = 0.35;
/// The share by which the bag is narrower at its back.
const NARROWED: f64 = 0.3;
/// Radius of the arc by which a lip rolls inward in the middle of the mouth, in widths (2.5 mm).
const ROLL: f64 = 0.05;
/// Places of the rings along the arc, as shares of its angle.
const ROLL_RINGS: [f64; 3] = [0.33, 0.67, 1.0];
/// Depth at which the arc's offset up or down has faded out, as a share of the bag's depth.
const ROLL_GONE: f64 = 0.3;
/// How far from the slit the slope of a lip's front is measured, in widths (2 mm).
const SLOPE_REACH: f64 = 0.04;
/// An arc starts this much further inward than the front of the other lip, radians (10 degrees).
const CLEARANCE: f64 = 0.17;
/// A steeper front counts as this steep, radians (70 degrees), so that every arc has a length.
const STEEPEST: f64 = 1.22;
/// Radius at the corners of the mouth, as a share of that in the middle. It is not zero, so that no
/// ring falls on the slit.
const ROLL_AT_CORNERS: f64 = 0.1;
/// Passes of a binomial filter along the slopes of a lip.
const SLOPE_SMOOTHING: usize = 6;
/// Passes of a binomial filter from ring to ring, so that a wavy slit ends in a smooth throat.
const SMOOTHING: usize = 2;

/// Faces behind a slit.
pub(super) struct Bag {
    /// The faces of the lips' inner sides come first.
    pub faces: Vec<[u32; 3]>,
    /// How many of the faces belong to the lips.
    pub lip_faces: usize,
}

/// Adds the vertices of a bag behind the slit of `cut` and returns its faces.
pub(super) fn sew_bag(cut: &mut CutMesh, mesh: &Mesh, frame: &MouthFrame) -> Bag {
    let at = |&v: &u32| frame.local_of(cut.positions[v as usize]);
    let mut line: Vec<DVec3> = cut.upper.iter().map(at).collect();
    let shape = Shape {
        places: places(&line),
        depth: depth(mesh, frame, line[line.len() / 2]),
    };
    let rolls = Roll::of_lips(cut, &line, &shape, frame);
    let mut rings = Rings {
        cut,
        frame,
        faces: Vec::new(),
    };
    let mut rims = [rings.cut.upper.clone(), rings.cut.lower.clone()];
    for part in ROLL_RINGS {
        let [above, below] = rolls.each_ref().map(|roll| roll.row(&line, part, 1.0));
        rims = rings.add(rims, &above, &below);
    }
    let lip_faces = rings.faces.len();
    for (number, back) in RINGS.into_iter().enumerate() {
        (0..SMOOTHING * number.min(1)).for_each(|_| smooth(&mut line));
        let left = 1.0 - ramp(back / ROLL_GONE);
        let row = |roll: &Roll| roll.row(&shape.row(&line, back, roll.side), 1.0, left);
        let [above, below] = rolls.each_ref().map(row);
        rims = rings.add(rims, &above, &below);
    }
    let [upper, lower] = rims;
    let mut faces = rings.faces;
    strip(&mut faces, &lower, &upper);
    if cut.is_inside_out {
        faces.iter_mut().for_each(|face| face.swap(1, 2));
    }
    Bag { faces, lip_faces }
}

/// Builds a bag ring by ring.
struct Rings<'a> {
    cut: &'a mut CutMesh,
    frame: &'a MouthFrame,
    faces: Vec<[u32; 3]>,
}

impl Rings<'_> {
    /// Adds an upper and a lower row of vertices, which share their ends, and sews them to the two
    /// rows before.
    fn add(
        &mut self,
        [upper, lower]: [Vec<u32>; 2],
        above: &[DVec3],
        below: &[DVec3],
    ) -> [Vec<u32>; 2] {
        let last = upper.len() - 1;
        let mut add = |local: DVec3, like: u32| {
            let place = self.frame.point(local).as_vec3().into();
            self.cut.positions.push(place);
            self.cut.sources.push(self.cut.sources[like as usize]);
            self.cut.positions.len() as u32 - 1
        };
        let inner_upper: Vec<u32> = (0..=last).map(|i| add(above[i], upper[i])).collect();
        let mut inner_lower: Vec<u32> = (1..last).map(|i| add(below[i], lower[i])).collect();
        inner_lower.insert(0, inner_upper[0]);
        inner_lower.push(inner_upper[last]);
        strip(&mut self.faces, &inner_upper, &upper);
        strip(&mut self.faces, &lower, &inner_lower);
        [inner_upper, inner_lower]
    }
}

/// The arcs by which one lip rolls inward.
struct Roll {
    /// 1 for the upper lip, −1 for the lower one.
    side: f64,
    /// For each vertex of the slit the angle at which the lip's front leads inward: 0 leads along
    /// the face, a quarter turn straight back.
    slopes: Vec<f64>,
    /// For each vertex the radius of its arc, in widths.
    radii: Vec<f64>,
}

impl Roll {
    /// The arcs of the upper lip and those of the lower one.
    fn of_lips(cut: &CutMesh, line: &[DVec3], shape: &Shape, frame: &MouthFrame) -> [Roll; 2] {
        let fronts = cut.fronts(frame);
        let slopes = [1.0, -1.0].map(|side| {
            let slope = |p: &DVec3| {
                let beside = DVec2::new(p.x, p.y + side * SLOPE_REACH);
                let front = fronts.depth(beside).unwrap_or(p.z);
                (front - p.z).atan2(SLOPE_REACH)
            };
            let mut slopes: Vec<f64> = line.iter().map(slope).collect();
            (0..SLOPE_SMOOTHING).for_each(|_| smooth(&mut slopes));
            slopes
        });
        [(0, 1.0), (1, -1.0)].map(|(lip, side)| {
            let pairs = slopes[lip].iter().zip(&slopes[1 - lip]);
            let clear = pairs.map(|(slope, opposite)| slope.max(CLEARANCE - opposite));
            Roll {
                side,
                slopes: clear.map(|slope| slope.clamp(0.0, STEEPEST)).collect(),
                radii: shape
                    .places
                    .iter()
                    .map(|place| ROLL * inward(*place).max(ROLL_AT_CORNERS))
                    .collect(),
            }
        })
    }

    /// A row of vertices moved along `part` of the arc. `height`: the share of the arc's offset up
    /// or down that is left.
    fn row(&self, line: &[DVec3], part: f64, height: f64) -> Vec<DVec3> {
        let arcs = self.slopes.iter().zip(&self.radii);
        let moved = line.iter().zip(arcs).map(|(p, (&slope, radius))| {
            let angle = slope + part * (FRAC_PI_2 - slope);
            let across = radius * (angle.sin() - slope.sin());
            let deep = radius * (slope.cos() - angle.cos());
            *p - DVec3::new(0.0, self.side * height * across, deep)
        });
        moved.collect()
    }
}

struct Shape {
    /// For each vertex of the slit its place along it: 0 at the right corner, 1 at the left one.
    places: Vec<f64>,
    /// Depth of the bag, in widths.
    depth: f64,
}

impl Shape {
    /// A row of vertices in the mouth's frame. `back`: its depth as a share of the bag's. `side`: 1
    /// above the slit, −1 below.
    fn row(&self, line: &[DVec3], back: f64, side: f64) -> Vec<DVec3> {
        let middle = 0.5 * (line[0][0] + line[line.len() - 1][0]);
        let rise = ramp((back - 0.08) / 0.4) * (1.0 - 0.35 * ramp((back - 0.7) / 0.3));
        let height = HEIGHT * (self.depth / DEPTH).min(1.0) * rise;
        let row = line.iter().zip(&self.places);
        row.map(|(&DVec3 { x, y, z }, place)| {
            let inward = inward(*place);
            let deep = DEPTH_AT_CORNERS + (1.0 - DEPTH_AT_CORNERS) * inward;
            DVec3::new(
                middle + (x - middle) * (1.0 - NARROWED * back),
                y + side * height * inward,
                z - self.depth * back * deep,
            )
        })
        .collect()
    }
}

/// 0 at the corners, 1 in the middle, like half a circle.
fn inward(place: f64) -> f64 {
    (4.0 * place * (1.0 - place)).max(0.0).sqrt()
}

/// Rises from 0 at 0 to 1 at 1, level at both ends.
fn ramp(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// How far along a line each of its points lies, 0 to 1.
fn places(line: &[DVec3]) -> Vec<f64> {
    let mut places = vec![0.0];
    for ends in line.windows(2) {
        places.push(places[places.len() - 1] + ends[0].distance(ends[1]));
    }
    let whole = places[places.len() - 1].max(f64::MIN_POSITIVE);
    places.iter().map(|place| place / whole).collect()
}

/// How deep a bag may be behind the middle of the slit, in widths.
fn depth(mesh: &Mesh, frame: &MouthFrame, middle: DVec3) -> f64 {
    let behind = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| {
            let way = frame.local(mesh.point(v)) - middle;
            [way.x, way.y, -way.z]
        });
        let turn = |p: [f64; 3], q: [f64; 3]| p[0] * q[1] - p[1] * q[0];
        let [u, v, w] = [turn(b, c), turn(c, a), turn(a, b)];
        let is_hit = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let depth = (u * a[2] + v * b[2] + w * c[2]) / (u + v + w);
        (is_hit && depth > LIPS).then_some(depth)
    };
    let nearest = mesh
        .triangles
        .iter()
        .filter_map(behind)
        .fold(f64::INFINITY, f64::min);
    (SHARE_OF_HEAD * nearest).clamp(LEAST_DEPTH, DEPTH)
}

fn smooth<T: Copy + Add<Output = T> + Mul<f64, Output = T>>(line: &mut [T]) {
    let old = line.to_vec();
    for i in 1..line.len() - 1 {
        line[i] = old[i - 1] * 0.25 + old[i] * 0.5 + old[i + 1] * 0.25;
    }
}

/// Adds the faces between two rows. They wind so that their sides on `a` run in its order. The
/// diagonals mirror each other about the middle. Faces that would be empty because the rows share a
/// vertex are left out.
fn strip(faces: &mut Vec<[u32; 3]>, a: &[u32], b: &[u32]) {
    let columns = a.len() - 1;
    for i in 0..columns {
        let [p, q, r, s] = [a[i], a[i + 1], b[i + 1], b[i]];
        let halves = if 2 * i < columns {
            [[p, q, r], [p, r, s]]
        } else {
            [[p, q, s], [q, r, s]]
        };
        let is_proper = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        faces.extend(halves.into_iter().filter(is_proper));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_start_at_the_lips_and_close_at_the_throat() {
        let line: Vec<DVec3> = (0..11).map(|i| DVec3::X * (0.1 * f64::from(i))).collect();
        let shape = Shape {
            places: places(&line),
            depth: DEPTH,
        };
        let height = |back: f64| {
            let [above, below] = [1.0, -1.0].map(|side| shape.row(&line, back, side)[5][1]);
            above - below
        };
        assert!(height(RINGS[0]) < 1e-6 && height(0.5) > 0.4);
        assert!(height(1.0) < height(0.5));
        let back = shape.row(&line, 1.0, 1.0);
        assert!((back[5][2] + DEPTH).abs() < 1e-9 && back[0][2] > -0.5 * DEPTH);
        assert!((back[0][1]).abs() < 1e-9);
    }

    #[test]
    fn rows_that_share_their_ends_leave_no_faces_without_area() {
        let mut faces = Vec::new();
        strip(&mut faces, &[0, 1, 2, 3], &[0, 4, 5, 3]);
        assert_eq!(faces.len(), 4);
    }
}
