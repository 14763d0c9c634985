//! The inner-lip gap: how far the mouth is open.

use super::Clip;
use crate::{Error, Result, motion::LANDMARKS};

/// Middle of the inner upper lip, iBUG-68.
const UPPER: usize = 62;
/// Middle of the inner lower lip, iBUG-68.
const LOWER: usize = 66;

/// Distance of landmarks 62 and 66 at every frame, in the clip's unit.
///
/// `landmarks`: `[T, 68, 3]` positions; add the neutral face to displacements first.
///
/// # Errors
/// `ShapeMismatch` for other shapes.
pub fn lip_gap(landmarks: Clip<'_>) -> Result<Vec<f64>> {
    let (frames, count, axes) = landmarks.dim();
    if (count, axes) != (LANDMARKS, 3) {
        return Err(Error::ShapeMismatch {
            what: "landmarks",
            expected: format!("[{frames}, {LANDMARKS}, 3]"),
            got: format!("{:?}", landmarks.shape()),
        });
    }
    let squared = |t: usize| -> f64 {
        (0..3)
            .map(|i| (landmarks[[t, UPPER, i]] - landmarks[[t, LOWER, i]]).powi(2))
            .sum()
    };
    Ok((0..frames).map(|t| squared(t).sqrt()).collect())
}
