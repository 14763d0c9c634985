//! Measures how the rims of an opened mouth part when the jaw drops by 20 mm.

use glam::{DVec2, DVec3};
use ndarray::{Array3, ArrayView2};

use super::{OpenedFace, patch::MouthFrame};
use crate::{
    Error, Result,
    mesh::{align_to_canonical, ibug::LANDMARKS},
};

/// How far the jaw drops, metres on a human head.
const DROP_M: f32 = 0.02;
/// How far the inner lips should part at each landmark from the right corner to the left one, as a
/// share of the drop.
const OPENINGS: [f64; 5] = [0.0, 0.85, 1.0, 0.85, 0.0];
/// Corners of the mouth follow the jaw by this share.
const CORNERS: f32 = 0.4;
/// The jaw moves back by this share of its drop.
const BACK: f32 = 0.3;
/// Places from corner to corner at which a rim is measured.
const PLACES: usize = 33;
/// This many places at either end do not count, because rims naturally turn and rise steeply there.
const CORNER_PLACES: usize = 3;

/// The measurements of a trial opening.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MouthTrial {
    /// Gap between the rims as a share of the landmarks' gap, where it is smallest between
    /// landmarks 61 and 63.
    pub parted: f64,
    /// The largest angle between neighbouring pieces of a rim, each a 32nd of its length, degrees:
    /// at rest, and open.
    pub bend_deg: [f64; 2],
    /// Largest difference in height between the right and left half of an open rim, as a share of
    /// the widest gap.
    pub asymmetry: f64,
    /// Triangles of the skin around the mouth that turn over.
    pub turned: usize,
}

impl OpenedFace {
    /// Measures the opening. `moved` `[V', 3]`: displacements of the vertices, mesh units and axes.
    ///
    /// # Errors
    /// `InvalidInput` where the landmarks do not describe a mouth.
    pub(crate) fn trial(&self, moved: ArrayView2<'_, f32>) -> Result<MouthTrial> {
        let to_canonical = align_to_canonical(&self.landmarks)?;
        let frame = MouthFrame::of(&self.landmarks, &to_canonical)?;
        let rest = |v: u32| self.mesh.point(v);
        let open = |v: u32| {
            let way = moved.row(v as usize);
            rest(v) + DVec3::new(way[0].into(), way[1].into(), way[2].into())
        };
        let drop = f64::from(DROP_M) / to_canonical.scale / frame.width;
        let gap = |(&u, &l): (&u32, &u32)| {
            let apart = |at: &dyn Fn(u32) -> DVec3| frame.local(at(u)).y - frame.local(at(l)).y;
            (frame.local(rest(u)).x, apart(&open) - apart(&rest))
        };
        let gaps: Vec<(f64, f64)> = self
            .upper_rim
            .iter()
            .zip(&self.lower_rim)
            .map(gap)
            .collect();
        let [from, to] = [61, 63].map(|n| frame.local_of(self.landmarks.positions[n]).x);
        let middle = places().filter(|place| (from..=to).contains(place));
        let shares =
            middle.map(|place| at(&gaps, place) / (drop * at(&expected_openings(), place)));
        let widest = places().map(|place| at(&gaps, place)).fold(0.0, f64::max);
        let heights = [&self.upper_rim, &self.lower_rim].map(|rim| -> Vec<(f64, f64)> {
            let heights = rim
                .iter()
                .map(|&v| (frame.local(rest(v)).x, frame.local(open(v)).y));
            heights.collect()
        });
        let uneven = |heights: &Vec<(f64, f64)>| {
            let apart = |place| (at(heights, place) - at(heights, 1.0 - place)).abs();
            let inner = places()
                .skip(CORNER_PLACES)
                .take(PLACES - 2 * CORNER_PLACES);
            inner.map(apart).fold(0.0, f64::max)
        };
        let uneven = uneven(&heights[0]).max(uneven(&heights[1]));
        let bend = |at: &dyn Fn(u32) -> DVec3| {
            let rims = [&self.upper_rim, &self.lower_rim];
            let flat = rims.map(|rim| rim.iter().map(|&v| frame.local(at(v)).truncate()));
            let bends = flat.map(|rim| largest_bend(&rim.collect::<Vec<DVec2>>()));
            bends[0].max(bends[1]).to_degrees()
        };
        Ok(MouthTrial {
            parted: shares.fold(f64::INFINITY, f64::min),
            bend_deg: [bend(&rest), bend(&open)],
            asymmetry: uneven / widest.max(f64::MIN_POSITIVE),
            turned: self.turned(&frame, open),
        })
    }

    /// Triangles of the skin around the mouth whose normal turns by more than a right angle.
    fn turned(&self, frame: &MouthFrame, open: impl Fn(u32) -> DVec3) -> usize {
        let skin = &self.mesh.triangles[..self.first_lining_triangle];
        let normal = |corners: [DVec3; 3]| (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let turns = |t: &&[u32; 3]| {
            let rest = t.map(|v| self.mesh.point(v));
            let is_near = (frame.local(rest[0]) - DVec3::X * 0.5).length() < 1.0;
            is_near && normal(rest).dot(normal(t.map(&open))) < 0.0
        };
        skin.iter().filter(turns).count()
    }
}

impl MouthTrial {
    /// Motion of the landmarks `[1, 68, 3]`, canonical metres: the jaw drops and takes the lower
    /// lip along.
    pub fn jaw_drop() -> Array3<f32> {
        let mut moved = Array3::zeros((1, LANDMARKS, 3));
        let mut drop = |n: usize, share: f32| {
            moved[[0, n, 1]] = -DROP_M * share;
            moved[[0, n, 2]] = -DROP_M * BACK * share;
        };
        for n in 2..=14 {
            drop(n, (1.0 - n.abs_diff(8) as f32 / 6.5).max(0.0));
        }
        for (n, share) in [(66, OPENINGS[2]), (65, OPENINGS[1]), (67, OPENINGS[1])] {
            drop(n, share as f32);
        }
        for (n, share) in [(57, 1.0), (56, 0.95), (58, 0.95), (55, 0.75), (59, 0.75)] {
            drop(n, share);
        }
        for n in [48, 54, 60, 64] {
            drop(n, CORNERS);
        }
        moved
    }

    /// Lips have to part by at least this share of the landmarks' gap.
    const LEAST_PARTED: f64 = 0.8;
    const MAX_ASYMMETRY: f64 = 0.1;
    /// A rim that bends by more than this shows a spike. Good mouths bend by up to 27 degrees.
    const MAX_BEND_DEG: f64 = 35.0;

    /// # Errors
    /// `Mesh` with the problem and advice on how to solve it.
    pub(crate) fn check(&self) -> Result<()> {
        let MouthTrial {
            parted,
            bend_deg,
            asymmetry,
            ..
        } = *self;
        let bend = bend_deg[0].max(bend_deg[1]);
        let problem = if parted < Self::LEAST_PARTED {
            format!("rims that part by {parted:.2} of what the landmarks do")
        } else if asymmetry > Self::MAX_ASYMMETRY {
            format!("halves whose heights differ by {asymmetry:.2} of the gap")
        } else if bend > Self::MAX_BEND_DEG {
            format!("a rim that bends by {bend:.0} degrees")
        } else {
            return Ok(());
        };
        Err(Error::Mesh(format!(
            "open mouth: expected lips that part smoothly and alike on both sides when the jaw drops by \
             20 mm, got {problem}; the mesh is as it was. Put the landmarks of the mouth (48 to 67) where its \
             lips meet and try again, or cut the mouth by hand"
        )))
    }
}

fn places() -> impl Iterator<Item = f64> {
    (0..PLACES).map(|i| i as f64 / (PLACES - 1) as f64)
}

/// Places between the corners, and the share of the drop by which the lips should part there.
fn expected_openings() -> [(f64, f64); 5] {
    std::array::from_fn(|i| (0.25 * i as f64, OPENINGS[i]))
}

/// Interpolates linearly between values at ascending places.
fn at(values: &[(f64, f64)], place: f64) -> f64 {
    let next = values.partition_point(|(x, _)| *x < place);
    let next = next.clamp(1, values.len() - 1);
    let ((x0, a), (x1, b)) = (values[next - 1], values[next]);
    a + (b - a) * ((place - x0) / (x1 - x0).max(1e-12)).clamp(0.0, 1.0)
}

/// Cuts a line into pieces of equal length. Returns the largest angle between two neighbours,
/// radians.
fn largest_bend(line: &[DVec2]) -> f64 {
    let mut length = vec![0.0];
    for ends in line.windows(2) {
        length.push(length[length.len() - 1] + ends[0].distance(ends[1]));
    }
    let whole = length[length.len() - 1];
    let along = |i: usize| -> Vec<(f64, f64)> {
        let points = length.iter().zip(line);
        points.map(|(l, p)| (l / whole, p[i])).collect()
    };
    let (xs, ys) = (along(0), along(1));
    let points: Vec<DVec2> = places()
        .map(|s| DVec2::new(at(&xs, s), at(&ys, s)))
        .collect();
    let inner = &points[CORNER_PLACES..PLACES - CORNER_PLACES];
    let bends = inner
        .windows(3)
        .map(|p| (p[1] - p[0]).angle_to(p[2] - p[1]).abs());
    bends.fold(0.0, f64::max)
}
