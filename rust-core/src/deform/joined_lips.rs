//! Lips that are one surface: what landmarks that part mean for skin that cannot.
//!
//! Landmarks of the two lips move apart when a mouth opens. On a surface without a slit they lie a
//! few millimetres from each other, and following them would draw out the skin in between. So the
//! opening is spread over all the skin from the nose to the chin, which then stretches evenly: the
//! skin above the lips, the lips and the chin each take the share of it that their own length is of
//! the whole. Both inner rims move as one seam; corners, width, protrusion and jaw stay as asked.
//!
//! The result is linear in the landmarks and mixes no axes.

use ndarray::{Array3, ArrayView3};
use serde::{Deserialize, Serialize};

use crate::{
    ibug::LANDMARKS,
    mesh::{
        Mouth,
        closest::{norm, sub},
    },
};

/// Inner-lip landmarks that face each other, upper and lower, from the subject's right to the left.
const PAIRS: [(usize, usize); 3] = [(61, 67), (62, 66), (63, 65)];
const CORNERS: (usize, usize) = (60, 64);
const OUTER_UPPER: std::ops::Range<usize> = 49..54;
const OUTER_LOWER: std::ops::Range<usize> = 55..60;
/// Below the nose, middle of the upper and of the lower lip's border, chin.
const PROFILE: [usize; 4] = [33, 51, 57, 8];

/// How landmarks of lips that are one surface are moved instead.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct JoinedLips {
    /// Landmark, and by which share of the opening of each pair it moves beyond its own way; the
    /// opening is the way of the upper landmark less that of the lower one.
    shifts: Vec<(usize, [f32; 3])>,
}

impl JoinedLips {
    /// `None` where the lips can part. `landmarks`: of the neutral face, any unit.
    pub(super) fn of(mouth: Mouth, landmarks: &[[f32; 3]; LANDMARKS]) -> Option<JoinedLips> {
        if mouth != Mouth::Welded {
            return None;
        }
        let length = |a: usize, b: usize| norm(sub(landmarks[a], landmarks[b]));
        let parts = [0, 1, 2].map(|i| length(PROFILE[i], PROFILE[i + 1]));
        let whole: f32 = parts.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        let [above, lips, below] = parts.map(|part| part / whole);
        let mut shifts = Vec::new();
        for (k, (upper, lower)) in PAIRS.into_iter().enumerate() {
            let to_seam = above + lips * height_of_seam(landmarks, k);
            let of = |share: f32| std::array::from_fn(|j| if j == k { share } else { 0.0 });
            shifts.push((upper, of(-to_seam)));
            shifts.push((lower, of(1.0 - to_seam)));
        }
        let beside = |n: usize, share: f32| (n, openings_at(landmarks, n).map(|w| share * w));
        shifts.extend(OUTER_UPPER.map(|n| beside(n, -above)));
        shifts.extend(OUTER_LOWER.map(|n| beside(n, below)));
        Some(JoinedLips { shifts })
    }

    /// Displacements that keep the lips together. `landmarks`: `[T, 68, 3]`, any unit and axes.
    pub(super) fn apply(&self, landmarks: ArrayView3<'_, f32>) -> Array3<f32> {
        let mut out = landmarks.to_owned();
        for (mut moved, asked) in out.outer_iter_mut().zip(landmarks.outer_iter()) {
            for axis in 0..3 {
                let opening = PAIRS.map(|(u, l)| asked[[u, axis]] - asked[[l, axis]]);
                for (n, shares) in &self.shifts {
                    let shift: f32 = (0..3).map(|k| shares[k] * opening[k]).sum();
                    moved[[*n, axis]] += shift;
                }
            }
        }
        out
    }
}

/// Share of the way from the upper lip's border to the lower one's at which a pair meets.
fn height_of_seam(landmarks: &[[f32; 3]; LANDMARKS], pair: usize) -> f32 {
    let (upper, lower) = PAIRS[pair];
    let seam = std::array::from_fn(|i| 0.5 * (landmarks[upper][i] + landmarks[lower][i]));
    let above = norm(sub(landmarks[50 + pair], seam));
    let below = norm(sub(landmarks[58 - pair], seam));
    above / (above + below).max(f32::MIN_POSITIVE)
}

/// By which shares the opening beside landmark `n` is that of each pair: in between by its place from
/// corner to corner, nothing at the corners.
fn openings_at(landmarks: &[[f32; 3]; LANDMARKS], n: usize) -> [f32; 3] {
    let (start, end) = (landmarks[CORNERS.0], landmarks[CORNERS.1]);
    let way = sub(end, start);
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let length = dot(way, way).max(f32::MIN_POSITIVE);
    let place = |n: usize| dot(sub(landmarks[n], start), way) / length;
    let mut knots = [0.0f32; 5];
    knots[4] = 1.0;
    for (k, (upper, lower)) in PAIRS.into_iter().enumerate() {
        let middle = 0.5 * (place(upper) + place(lower));
        knots[k + 1] = middle.clamp(knots[k], 1.0);
    }
    let at = place(n).clamp(0.0, 1.0);
    let after = knots.partition_point(|knot| *knot < at).clamp(1, 4);
    let gap = (knots[after] - knots[after - 1]).max(1e-6);
    let along = ((at - knots[after - 1]) / gap).clamp(0.0, 1.0);
    let share = |knot: usize| match knot {
        _ if knot == after => along,
        _ if knot + 1 == after => 1.0 - along,
        _ => 0.0,
    };
    [1, 2, 3].map(share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    fn opening() -> Array3<f32> {
        let mut moved = Array3::zeros((1, LANDMARKS, 3));
        for n in (55..60).chain(65..68).chain(6..11) {
            moved[[0, n, 1]] = -0.02;
        }
        moved
    }

    #[test]
    fn lips_that_part_are_left_alone() {
        for mouth in [Mouth::Open, Mouth::Slit] {
            assert_eq!(JoinedLips::of(mouth, canonical_landmarks()), None);
        }
    }

    #[test]
    fn inner_lips_move_as_one_and_the_skin_stretches_evenly() {
        let rest = canonical_landmarks();
        let joined = JoinedLips::of(Mouth::Welded, rest).unwrap();
        let moved = joined.apply(opening().view());
        let way = |n: usize| moved[[0, n, 1]];
        for (upper, lower) in PAIRS {
            assert!((way(upper) - way(lower)).abs() < 1e-6);
            assert!(way(upper) < -0.002);
        }
        let longer = PROFILE.windows(2).map(|ends| {
            let [a, b] = [ends[0], ends[1]];
            let before = norm(sub(rest[a], rest[b]));
            (way(a) - way(b)) / before
        });
        let longer: Vec<f32> = longer.collect();
        for stretch in &longer {
            assert!((stretch - longer[0]).abs() < 0.01, "{longer:?}");
        }
    }

    #[test]
    fn what_opens_nothing_stays() {
        let joined = JoinedLips::of(Mouth::Welded, canonical_landmarks()).unwrap();
        let mut moved = Array3::zeros((2, LANDMARKS, 3));
        moved.fill(0.004);
        moved[[1, 48, 0]] = 0.01;
        assert_eq!(joined.apply(moved.view()), moved);
    }

    #[test]
    fn corners_and_chin_are_never_shifted() {
        let joined = JoinedLips::of(Mouth::Welded, canonical_landmarks()).unwrap();
        let moved = joined.apply(opening().view());
        for n in [8, 33, 48, 54, 60, 64] {
            assert_eq!(moved[[0, n, 1]], opening()[[0, n, 1]]);
        }
    }
}
