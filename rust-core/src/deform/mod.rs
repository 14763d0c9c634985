//! Landmark motion spread over a whole mesh.

use crate::{Result, progress::ProgressFn};
use ndarray::{Array3, ArrayView3};

/// Displacements of every vertex over time.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexClip {
    /// `[T, V, 3]`, in the mesh's own units, axes and vertex order.
    pub displacements: Array3<f32>,
    /// Frames per second.
    pub fps: f64,
}

/// Spreads landmark displacements over one prepared mesh.
pub trait Deformer: Send + Sync {
    /// `landmarks`: `[T, 68, 3]`, mesh units and axes. Returns `[T, V, 3]`, the same.
    ///
    /// # Errors
    /// `ShapeMismatch` if `landmarks` is not `[T, 68, 3]`; `Cancelled`.
    fn deform(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>>;
}
