//! Motion of 68 landmarks over time, before any mesh is known.

mod closures;
mod resample;
mod smooth;

pub use closures::close_lips;

use ndarray::Array3;

/// Number of iBUG landmarks `N`.
pub const LANDMARKS: usize = 68;

/// Landmark displacements from the neutral face.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionClip {
    /// `[T, 68, 3]`, canonical metres: +x to the subject's left, +y up, +z out of the face.
    pub displacements: Array3<f32>,
    /// Frames per second.
    pub fps: f64,
}
