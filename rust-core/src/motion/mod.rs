//! Motion of 68 landmarks over time, before any mesh is known.

mod articulation;
mod blinks;
mod brow_accents;
mod chance;
mod closures;
mod controls;
mod face_modes;
mod perform;
mod regions;
mod resample;
mod smooth;
mod upper_face;

use ndarray::Array3;

pub use blinks::{Blink, blinks};
pub use brow_accents::{BrowAccent, brow_accents};
pub use closures::close_lips;
pub use controls::PerformanceControls;
pub use face_modes::FaceModes;
pub use perform::Cues;

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
