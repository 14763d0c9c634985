//! The width of the mouth.

use super::{Clip, lip_gap::distances};
use anyface::Result;

/// The outer corners of the mouth, iBUG-68.
const CORNERS: [usize; 2] = [48, 54];

/// Distance between landmarks 48 and 54 in every frame, in the clip's unit.
///
/// `landmarks`: `[T, 68, 3]` positions; add the neutral face to displacements first.
///
/// # Errors
/// `ShapeMismatch` for other shapes.
pub fn mouth_width(landmarks: Clip<'_>) -> Result<Vec<f64>> {
    distances(landmarks, CORNERS)
}
