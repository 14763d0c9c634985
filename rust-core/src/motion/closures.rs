//! Lips that touch where the sound says p, b or m.
//!
//! Whatever is trained by squared error blurs closure, which lasts a frame or two; the speech
//! encoder's own read-out of it does not. Twin of `lips_closed` in
//! `training/corpus/closures.py`.

use ndarray::Array3;

use crate::{Error, Result};

/// Probabilities between which the lips go from as they are to touching.
const SURE_FROM: f32 = 0.1;
const SURE_AT: f32 = 0.35;
/// Opening over that of the neutral face at which lips touch in speech, metres.
const TOUCHING: f32 = -0.5e-3;
/// Upper and lower landmark of the three inner lip pairs.
const INNER: [(usize, usize); 3] = [(61, 67), (62, 66), (63, 65)];
/// Outer pairs, the inner pair that each follows, and how far.
const OUTER: [((usize, usize), usize, f32); 5] = [
    ((49, 59), 0, 0.4),
    ((50, 58), 0, 0.8),
    ((51, 57), 1, 1.0),
    ((52, 56), 2, 0.8),
    ((53, 55), 2, 0.4),
];
/// Part of a closing motion that the upper lip makes.
const UPPER_SHARE: f32 = 0.35;

/// Closes the lips of a motion `[T, 68, 3]` (canonical metres) where `probability` `[T]` is high.
///
/// A smooth step from 0.1 to 0.35 decides how far the gap of each inner pair goes to where lips
/// touch; it never widens. The frames beside stay as the network made them, which moves as recorded lips
/// do, and so do the corners.
///
/// # Errors
/// `ShapeMismatch` if there is not one probability a frame.
pub fn close_lips(displacements: &mut Array3<f32>, probability: &[f32]) -> Result<()> {
    let frames = displacements.dim().0;
    if probability.len() != frames {
        return Err(Error::ShapeMismatch {
            what: "probability of closed lips",
            expected: format!("[{frames}]"),
            got: format!("[{}]", probability.len()),
        });
    }
    for (t, mut face) in displacements.outer_iter_mut().enumerate() {
        let share = smooth_step(probability[t]);
        if share == 0.0 {
            continue;
        }
        let by = INNER.map(|(upper, lower)| {
            let gap = face[[upper, 1]] - face[[lower, 1]];
            share * (gap - TOUCHING).max(0.0)
        });
        let mut narrow = |(upper, lower): (usize, usize), by: f32| {
            face[[upper, 1]] -= UPPER_SHARE * by;
            face[[lower, 1]] += (1.0 - UPPER_SHARE) * by;
        };
        for (pair, by) in INNER.into_iter().zip(by) {
            narrow(pair, by);
        }
        for (pair, follows, part) in OUTER {
            narrow(pair, part * by[follows]);
        }
    }
    Ok(())
}

/// How far the lips go to touching.
fn smooth_step(probability: f32) -> f32 {
    let x = ((probability - SURE_FROM) / (SURE_AT - SURE_FROM)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three frames of an open mouth, 10 mm at the inner lips.
    fn open() -> Array3<f32> {
        let mut motion = Array3::zeros((3, 68, 3));
        for t in 0..3 {
            for lower in [55, 56, 57, 58, 59, 65, 66, 67] {
                motion[[t, lower, 1]] = -0.01;
            }
        }
        motion
    }

    #[test]
    fn sure_closures_touch_and_unlikely_ones_change_nothing() {
        let mut motion = open();
        close_lips(&mut motion, &[0.9, 0.1, 0.1]).unwrap();
        for (upper, lower) in INNER {
            let gap = |t| motion[[t, upper, 1]] - motion[[t, lower, 1]];
            assert!((gap(0) - TOUCHING).abs() < 1e-7, "{}", gap(0));
        }
        let later = |m: &Array3<f32>| m.slice(ndarray::s![1.., .., ..]).to_owned();
        assert_eq!(later(&motion), later(&open()));
    }

    #[test]
    fn lips_that_are_closer_already_stay() {
        let mut motion = Array3::zeros((1, 68, 3));
        motion[[0, 66, 1]] = 0.002;
        motion[[0, 65, 1]] = 0.002;
        motion[[0, 67, 1]] = 0.002;
        let before = motion.clone();
        close_lips(&mut motion, &[1.0]).unwrap();
        assert_eq!(motion, before);
    }

    #[test]
    fn corners_and_the_rest_of_the_face_stay() {
        let mut motion = open();
        close_lips(&mut motion, &[1.0, 1.0, 1.0]).unwrap();
        let moved = |n: &usize| motion[[0, *n, 1]] != open()[[0, *n, 1]];
        let found: Vec<usize> = (0..68).filter(moved).collect();
        assert_eq!(
            found,
            [
                49, 50, 51, 52, 53, 55, 56, 57, 58, 59, 61, 62, 63, 65, 66, 67
            ]
        );
    }

    #[test]
    fn closing_is_the_same_on_both_sides() {
        let mut motion = open();
        close_lips(&mut motion, &[0.2, 0.3, 0.1]).unwrap();
        for (left, right) in [(61, 63), (67, 65), (49, 53), (59, 55), (50, 52), (58, 56)] {
            assert_eq!(motion[[0, left, 1]], motion[[0, right, 1]]);
        }
    }

    #[test]
    fn wrong_lengths_are_refused() {
        let message = close_lips(&mut open(), &[0.5]).unwrap_err().to_string();
        assert!(
            message.contains("[3]") && message.contains("[1]"),
            "{message}"
        );
    }
}
