//! The shapes of one mesh, and what came of each.

use ndarray::{Array3, ArrayView2};
use serde::Serialize;

/// A shape that moves no vertex further than this on a human head counts as missing.
const NEAR_ZERO_MM: f32 = 0.2;

/// The shapes of one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// `[S]`: the 52 of [`ARKIT`](crate::rig::ARKIT), then the 15 of [`VISEMES`](crate::rig::VISEMES); by the field of a head shapes in between may follow.
    pub names: Vec<String>,
    /// `[S, V, 3]`, displacement of every vertex at strength 1, mesh units and axes.
    pub deltas: Array3<f32>,
    /// `[S]`.
    pub reports: Vec<ShapeReport>,
}

/// What came of one shape.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ShapeReport {
    /// Its name.
    pub name: String,
    /// Largest displacement of a vertex, mesh units.
    pub largest: f32,
    /// The same on a human head.
    pub largest_mm: f32,
    /// Whether anything moves visibly.
    pub present: bool,
    /// Why nothing moves, or what does not move along.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl ShapeReport {
    /// Of a shape `[V, 3]` in mesh units, of which `scale` are metres on a human head; `note` is told whether it moves
    /// visibly.
    pub(crate) fn of(
        name: &str,
        shape: ArrayView2<'_, f32>,
        scale: f32,
        note: impl FnOnce(bool) -> Option<String>,
    ) -> ShapeReport {
        let squared = shape.rows().into_iter().map(|d| d.dot(&d));
        let largest = squared.fold(0.0f32, f32::max).sqrt();
        let largest_mm = 1000.0 * scale * largest;
        let present = largest_mm > NEAR_ZERO_MM;
        ShapeReport {
            note: note(present),
            name: name.to_owned(),
            largest,
            largest_mm,
            present,
        }
    }
}
