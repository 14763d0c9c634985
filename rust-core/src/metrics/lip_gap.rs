//! The inner-lip gap: how far the mouth is open.

use super::Clip;
use crate::{Error, Result, motion::LANDMARKS};

/// Middle of the inner upper lip, iBUG-68.
const UPPER: usize = 62;
/// Middle of the inner lower lip, iBUG-68.
const LOWER: usize = 66;

/// Height of landmark 62 over landmark 66 at every frame, in the clip's unit.
///
/// `landmarks`: `[T, 68, 3]`, +y up. From displacements the result differs from the true gap by
/// the neutral gap, which no correlation sees. Height, not distance: depth is the weakest part of
/// motion that was measured from video.
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
    Ok((0..frames)
        .map(|t| landmarks[[t, UPPER, 1]] - landmarks[[t, LOWER, 1]])
        .collect())
}
