//! Limits how far the lips of a head part.
//!
//! The speech model opens the mouth too far on voices unlike those that it learned. The limits come
//! from recordings.

use ndarray::{Array2, ArrayView3};

use crate::mesh::ibug::INNER_LIPS;

/// The widest gap. Recordings reach 28.2 mm in facegood_zh and 23.7 mm in grid_s1.
const WIDEST_M: f32 = 28e-3;
/// Gaps up to this size stay as they are: 99.5 % of the recorded gaps are smaller.
const USUAL_M: f32 = 20e-3;

/// In frames whose lips part too far, moves the codes `[T, X]` towards the code at rest, `[X]`.
///
/// `displacements`: how these codes move landmarks from rest, `[T, 68, 3]` metres. Returns the
/// numbers of the frames that it changed.
pub(super) fn bound_opening(
    codes: &mut Array2<f32>,
    rest: &[f32],
    displacements: ArrayView3<'_, f32>,
) -> Vec<usize> {
    let mut moved = Vec::new();
    let frames = codes.outer_iter_mut().zip(displacements.outer_iter());
    for (t, (mut code, frame)) in frames.enumerate() {
        let (upper, lower) = INNER_LIPS[1];
        let gap = frame[[upper, 1]] - frame[[lower, 1]];
        if gap > USUAL_M {
            let share = bounded(gap) / gap;
            for (x, rest) in code.iter_mut().zip(rest) {
                *x = rest + share * (*x - rest);
            }
            moved.push(t);
        }
    }
    moved
}

/// Compresses a gap beyond `USUAL_M` smoothly, so that it does not exceed `WIDEST_M`.
fn bounded(gap: f32) -> f32 {
    let room = WIDEST_M - USUAL_M;
    USUAL_M + room * ((gap - USUAL_M) / room).tanh()
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, array};

    use super::*;

    fn opening(gaps: &[f32]) -> Array3<f32> {
        let (_, lower) = INNER_LIPS[1];
        Array3::from_shape_fn((gaps.len(), 68, 3), |(t, place, axis)| {
            if (place, axis) == (lower, 1) {
                -gaps[t]
            } else {
                0.0
            }
        })
    }

    #[test]
    fn usual_openings_stay_and_wide_ones_come_nearer_to_rest() {
        let mut codes = array![[3.0, 0.0], [3.0, 0.0], [3.0, 0.0]];
        let gaps = opening(&[0.0, 0.019, 0.035]);
        let moved = bound_opening(&mut codes, &[1.0, 0.0], gaps.view());
        assert_eq!(moved, [2]);
        assert_eq!(codes.slice(ndarray::s![..2, 0]), array![3.0, 3.0]);
        let share = (codes[[2, 0]] - 1.0) / 2.0;
        assert!((0.75..0.8).contains(&share), "{share}");
    }

    #[test]
    fn bounded_gaps_grow_without_a_corner_and_end_at_the_widest() {
        let gaps: Vec<f32> = (0..200)
            .map(|i| bounded(USUAL_M + 5e-4 * i as f32))
            .collect();
        assert!(gaps.iter().all(|&gap| gap <= WIDEST_M));
        assert!(gaps.windows(2).all(|pair| pair[1] >= pair[0]));
        assert!((gaps[1] - gaps[0] - 5e-4).abs() < 1e-5);
    }
}
