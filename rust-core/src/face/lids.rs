//! How far the skin beside an eye follows its lids.
//!
//! Twin of `lid_edge` and `lid_profile` in `training/deform/tension_screened_biharmonic.py`.
//! Lengths are centimetres in the canonical frame. The edge is a curve through the landmarks, not a
//! path over the mesh, so that it is the same on every triangulation.

use std::ops::Range;

/// Landmarks around each eye, corner to corner and back.
pub const EYES: [Range<usize>; 2] = [36..42, 42..48];

/// Points of the curve from one landmark to the next.
const CURVE_POINTS: usize = 8;
/// Outer skin follows the lid fully up to the first distance from the edge, and not at all from the
/// second on. Measured on ICT FaceKit's eyeBlink, like the next two.
const OUTER_CM: (f64, f64) = (0.3, 0.8);
/// The same for the lining behind the edge.
const INNER_CM: (f64, f64) = (0.5, 1.5);
/// Skin begins to count as lining at the first depth behind the nearest point of the edge, and
/// counts fully from the second on.
const BEHIND_CM: (f64, f64) = (0.1, 0.25);

/// The edge of both lids of one eye.
pub struct LidEdge {
    points: Vec<[f64; 3]>,
}

impl LidEdge {
    /// A closed Catmull-Rom curve through an eye's landmarks, sharp at its two corners.
    pub fn through(corners: &[[f64; 3]; 6]) -> LidEdge {
        let piece = |i: usize| {
            let [mut before, start, end, mut after] =
                [5, 0, 1, 2].map(|step| corners[(i + step) % 6]);
            if i.is_multiple_of(3) {
                before = start;
            }
            if i % 3 == 2 {
                after = end;
            }
            (0..CURVE_POINTS).map(move |k| {
                let t = k as f64 / CURVE_POINTS as f64;
                std::array::from_fn(|x| {
                    let (b, s, e, a) = (before[x], start[x], end[x], after[x]);
                    let linear = (e - b) * t;
                    let square = (2.0 * b - 5.0 * s + 4.0 * e - a) * t * t;
                    let cube = (3.0 * s - b - 3.0 * e + a) * t * t * t;
                    0.5 * (2.0 * s + linear + square + cube)
                })
            })
        };
        LidEdge {
            points: (0..6).flat_map(piece).collect(),
        }
    }

    /// The share, 0 to 1, by which a point of the skin follows the lids.
    pub fn share(&self, point: [f64; 3]) -> f64 {
        let squared =
            |edge: &[f64; 3]| -> f64 { (0..3).map(|x| (point[x] - edge[x]).powi(2)).sum() };
        let by_distance = self.points.iter().map(|edge| (squared(edge), edge));
        let Some((squared, nearest)) = by_distance.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return 0.0;
        };
        follow_share(squared.sqrt(), nearest[2] - point[2])
    }

    /// The edges of the upper and of the lower lid, both from the first corner to the second.
    pub fn both(&self) -> [Vec<[f64; 3]>; 2] {
        let half = self.points.len() / 2;
        let upper = self.points[..=half].to_vec();
        let mut lower = self.points[half..].to_vec();
        lower.push(upper[0]);
        lower.reverse();
        [upper, lower]
    }
}

/// The share by which skin follows a lid whose edge is `distance` away. `behind`: how far the skin
/// lies behind the edge.
pub fn follow_share(distance: f64, behind: f64) -> f64 {
    if distance >= INNER_CM.1 {
        return 0.0;
    }
    let inner = ((behind - BEHIND_CM.0) / (BEHIND_CM.1 - BEHIND_CM.0)).clamp(0.0, 1.0);
    ease_out(distance, OUTER_CM) * (1.0 - inner) + ease_out(distance, INNER_CM) * inner
}

/// 1 up to the span's start, 0 from its end on, smooth between.
fn ease_out(x: f64, (start, end): (f64, f64)) -> f64 {
    let s = ((end - x) / (end - start)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    fn left_eye() -> ([[f64; 3]; 6], LidEdge) {
        let corners = std::array::from_fn(|i| {
            canonical_landmarks()[EYES[1].start + i].map(|x| 100.0 * f64::from(x))
        });
        (corners, LidEdge::through(&corners))
    }

    #[test]
    fn the_edge_passes_through_its_landmarks_and_they_follow_fully() {
        let (corners, edge) = left_eye();
        for corner in corners {
            assert!(edge.points.contains(&corner), "{corner:?}");
            assert_eq!(edge.share(corner), 1.0);
        }
    }

    #[test]
    fn skin_above_the_lid_rests_and_its_lining_still_follows() {
        let (corners, edge) = left_eye();
        let lid = corners[1];
        let above = |cm: f64| edge.share([lid[0], lid[1] + cm, lid[2]]);
        assert_eq!(above(0.2), 1.0);
        assert!((0.1..0.9).contains(&above(0.55)));
        assert_eq!(above(0.9), 0.0);
        let behind = edge.share([lid[0], lid[1], lid[2] - 0.9]);
        assert!((0.1..0.9).contains(&behind), "{behind}");
    }

    #[test]
    fn both_eyes_of_a_symmetric_face_share_alike() {
        let (corners, left) = left_eye();
        // The right eye's landmarks run the other way round.
        let mirror = |p: [f64; 3]| [-p[0], p[1], p[2]];
        let right = LidEdge::through(&[3, 2, 1, 0, 5, 4].map(|i| mirror(corners[i])));
        for offset in [[0.1, 0.4, 0.0], [-0.5, 0.6, -0.3], [0.0, -0.5, 0.1]] {
            let point: [f64; 3] = std::array::from_fn(|x| corners[2][x] + offset[x]);
            let (a, b) = (left.share(point), right.share(mirror(point)));
            assert!((a - b).abs() < 0.02, "{a} and {b}");
        }
    }
}
