//! The inner-lip gap: how far the mouth is open.

use super::Clip;
use anyface::{Error, Result, mesh::ibug::LANDMARKS};

/// The middle landmarks of the inner upper and the inner lower lip, iBUG-68.
const MIDDLES: [usize; 2] = [62, 66];

/// Distance between landmarks 62 and 66 in every frame, in the clip's unit.
///
/// `landmarks`: `[T, 68, 3]` positions; add the neutral face to displacements first.
///
/// # Errors
/// `ShapeMismatch` for other shapes.
pub fn lip_gap(landmarks: Clip<'_>) -> Result<Vec<f64>> {
    distances(landmarks, MIDDLES)
}

/// Distance between two landmarks in every frame of `[T, 68, 3]`.
pub(super) fn distances(landmarks: Clip<'_>, [a, b]: [usize; 2]) -> Result<Vec<f64>> {
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
            .map(|i| (landmarks[[t, a, i]] - landmarks[[t, b, i]]).powi(2))
            .sum()
    };
    Ok((0..frames).map(|t| squared(t).sqrt()).collect())
}
