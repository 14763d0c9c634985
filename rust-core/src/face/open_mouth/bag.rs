//! The inside of a mouth: a bag sewn behind the parted lips.
//!
//! From the slit it goes straight back for the thickness of the lips, widens up and down behind them
//! and closes at the throat. Each of its rings has one vertex for each of the slit.

use glam::DVec3;

use super::{cut::CutMesh, patch::MouthFrame};
use crate::mesh::Mesh;

/// Depth, in widths of the mouth (40 mm), and the least where the head is thin.
const DEPTH: f64 = 0.8;
const LEAST_DEPTH: f64 = 0.15;
/// Of the way to the next surface behind the lips the bag takes so much at most.
const SHARE_OF_HEAD: f64 = 0.5;
/// What lies nearer behind the slit than this is the lips themselves, in widths.
const LIPS: f64 = 0.12;
/// Places of the rings on the way back.
const RINGS: [f64; 7] = [0.05, 0.13, 0.23, 0.36, 0.53, 0.75, 1.0];
/// Height above and below the slit, in widths (11 mm).
const HEIGHT: f64 = 0.22;
/// At the corners the bag is so deep, as a part of its depth in the middle.
const DEPTH_AT_CORNERS: f64 = 0.35;
/// By how much it is narrower at its back.
const NARROWED: f64 = 0.3;
/// Passes of a binomial filter from ring to ring: a wavy slit ends in a smooth throat.
const SMOOTHING: usize = 2;

/// Adds the vertices of a bag behind the slit of `cut` and returns its faces.
pub(super) fn sew_bag(cut: &mut CutMesh, mesh: &Mesh, frame: &MouthFrame) -> Vec<[u32; 3]> {
    let at = |&v: &u32| frame.local_of(cut.positions[v as usize]);
    let mut line: Vec<DVec3> = cut.upper.iter().map(at).collect();
    let shape = Shape {
        places: places(&line),
        depth: depth(mesh, frame, line[line.len() / 2]),
    };
    let mut faces = Vec::new();
    let (mut upper, mut lower) = (cut.upper.clone(), cut.lower.clone());
    let last = line.len() - 1;
    for (number, back) in RINGS.into_iter().enumerate() {
        (0..SMOOTHING * number.min(1)).for_each(|_| smooth(&mut line));
        let (above, below) = (shape.row(&line, back, 1.0), shape.row(&line, back, -1.0));
        let mut add = |local: DVec3, like: u32| {
            cut.positions.push(frame.point(local).as_vec3().into());
            cut.sources.push(cut.sources[like as usize]);
            cut.positions.len() as u32 - 1
        };
        let inner_upper: Vec<u32> = (0..=last).map(|i| add(above[i], upper[i])).collect();
        let mut inner_lower: Vec<u32> = (1..last).map(|i| add(below[i], lower[i])).collect();
        inner_lower.insert(0, inner_upper[0]);
        inner_lower.push(inner_upper[last]);
        strip(&mut faces, &inner_upper, &upper);
        strip(&mut faces, &lower, &inner_lower);
        (upper, lower) = (inner_upper, inner_lower);
    }
    strip(&mut faces, &lower, &upper);
    if cut.is_inside_out {
        faces.iter_mut().for_each(|face| face.swap(1, 2));
    }
    faces
}

struct Shape {
    /// Of each vertex of the slit: 0 at the right corner, 1 at the left one.
    places: Vec<f64>,
    /// In widths.
    depth: f64,
}

impl Shape {
    /// A row of vertices in the mouth's frame; `side`: 1 above the slit, −1 below.
    fn row(&self, line: &[DVec3], back: f64, side: f64) -> Vec<DVec3> {
        let middle = 0.5 * (line[0][0] + line[line.len() - 1][0]);
        let rise = ramp((back - 0.08) / 0.4) * (1.0 - 0.35 * ramp((back - 0.7) / 0.3));
        let height = HEIGHT * (self.depth / DEPTH).min(1.0) * rise;
        let row = line.iter().zip(&self.places);
        row.map(|(&DVec3 { x, y, z }, place)| {
            let inward = (4.0 * place * (1.0 - place)).max(0.0).sqrt();
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

/// From 0 at 0 to 1 at 1, level at both.
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

/// How deep a bag finds room behind the middle of the slit, in widths.
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

fn smooth(line: &mut [DVec3]) {
    let old = line.to_vec();
    for i in 1..line.len() - 1 {
        line[i] = 0.25 * old[i - 1] + 0.5 * old[i] + 0.25 * old[i + 1];
    }
}

/// Faces between two rows whose sides run from left to right on `a`; the diagonals are mirrored about
/// the middle, and nothing stands where the rows share a vertex.
fn strip(faces: &mut Vec<[u32; 3]>, a: &[u32], b: &[u32]) {
    let columns = a.len() - 1;
    for i in 0..columns {
        let [p, q, r, s] = [a[i], a[i + 1], b[i + 1], b[i]];
        let halves = match 2 * i < columns {
            true => [[p, q, r], [p, r, s]],
            false => [[p, q, s], [q, r, s]],
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
