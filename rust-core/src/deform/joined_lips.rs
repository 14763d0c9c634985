//! Adapts landmarks that part to lips that are one surface and cannot part.
//!
//! When a mouth opens, the landmarks of the two lips move apart. On a surface without a slit they
//! lie a few millimetres from each other, and following them would stretch the skin in between. So
//! this module spreads the opening of the lips' borders over all the skin from the nose to the
//! chin, which then stretches evenly. The skin above the lips, the lips and the skin below them
//! each take a share of the opening in proportion to their length. The inner rims move as one seam
//! in between. Corners, width, protrusion and jaw move as requested.
//!
//! The result is linear in the landmarks and does not mix the axes.

use glam::Vec3;
use ndarray::{Array3, ArrayView3};
use serde::{Deserialize, Serialize};

use crate::mesh::{
    Mouth,
    ibug::{INNER_LIPS, LANDMARKS, OUTER_LIPS},
};

/// For each inner pair, the index of the pair of borders that it lies between.
const BORDER_OF_INNER: [usize; 3] = [1, 2, 3];
/// Below the nose, middle of the upper lip's border, middle of the lower lip's border, chin.
const PROFILE: [usize; 4] = [33, 51, 57, 8];

/// How to move the landmarks of lips that are one surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct JoinedLips {
    /// Shares of an opening that the skin above the lips, the lips and the skin below them take;
    /// their sum is 1.
    shares: [f32; 3],
    /// For each inner pair, the share of the way from the upper to the lower border at which it
    /// meets.
    heights: [f32; 3],
}

impl JoinedLips {
    /// `None` where the lips can part. `landmarks`: of the neutral face, any unit.
    pub(super) fn of(mouth: Mouth, landmarks: &[[f32; 3]; LANDMARKS]) -> Option<JoinedLips> {
        if mouth != Mouth::Welded {
            return None;
        }
        let length =
            |i: usize| Vec3::from(landmarks[PROFILE[i]]).distance(landmarks[PROFILE[i + 1]].into());
        let lengths = [0, 1, 2].map(length);
        let whole: f32 = lengths.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        Some(JoinedLips {
            shares: lengths.map(|part| part / whole),
            heights: std::array::from_fn(|i| height_of_seam(landmarks, i)),
        })
    }

    /// Returns displacements that keep the lips together. `landmarks`: `[T, 68, 3]`, any unit and
    /// axes.
    pub(super) fn apply(&self, landmarks: ArrayView3<'_, f32>) -> Array3<f32> {
        let mut out = landmarks.to_owned();
        let [above, _, below] = self.shares;
        for mut moved in out.outer_iter_mut() {
            for axis in 0..3 {
                for (upper, lower) in OUTER_LIPS {
                    let opening = moved[[upper, axis]] - moved[[lower, axis]];
                    moved[[upper, axis]] -= above * opening;
                    moved[[lower, axis]] += below * opening;
                }
                for (i, (upper, lower)) in INNER_LIPS.into_iter().enumerate() {
                    let (above, below) = OUTER_LIPS[BORDER_OF_INNER[i]];
                    let [a, b] = [above, below].map(|n| moved[[n, axis]]);
                    let seam = a + self.heights[i] * (b - a);
                    (moved[[upper, axis]], moved[[lower, axis]]) = (seam, seam);
                }
            }
        }
        out
    }
}

/// The share of the way from the upper lip's border to the lower one's at which an inner pair
/// meets.
fn height_of_seam(landmarks: &[[f32; 3]; LANDMARKS], inner: usize) -> f32 {
    let (upper, lower) = INNER_LIPS[inner];
    let (border_above, border_below) = OUTER_LIPS[BORDER_OF_INNER[inner]];
    let seam = std::array::from_fn(|i| 0.5 * (landmarks[upper][i] + landmarks[lower][i]));
    let above = Vec3::from(landmarks[border_above]).distance(seam.into());
    let below = Vec3::from(landmarks[border_below]).distance(seam.into());
    above / (above + below).max(f32::MIN_POSITIVE)
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
        for (upper, lower) in INNER_LIPS {
            assert!((way(upper) - way(lower)).abs() < 1e-6);
            assert!(way(upper) < -0.002);
        }
        let longer = PROFILE.windows(2).map(|ends| {
            let [a, b] = [ends[0], ends[1]];
            let before = Vec3::from(rest[a]).distance(rest[b].into());
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
        let after = joined.apply(moved.view());
        for (a, b) in after.iter().zip(&moved) {
            assert!((a - b).abs() < 1e-8, "{a} {b}");
        }
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
