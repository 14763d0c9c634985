//! The shapes of one mesh, and a report on each.

use ndarray::{Array3, ArrayView2};
use serde::Serialize;

/// A shape that moves no vertex further than this on a human head counts as missing.
const NEAR_ZERO_MM: f32 = 0.2;

/// The shapes of one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// `[S]`: the 52 of [`ARKIT`](crate::rig::ARKIT), then the 15 of
    /// [`VISEMES`](crate::rig::VISEMES). In-between shapes may follow where the field of a head
    /// made the shapes.
    pub names: Vec<String>,
    /// `[S, V, 3]`, displacement of every vertex at strength 1, mesh units and axes.
    pub deltas: Array3<f32>,
    /// `[S]`: the report on each shape.
    pub reports: Vec<ShapeReport>,
}

/// The report on one shape.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ShapeReport {
    /// Its name.
    pub name: String,
    /// Largest displacement of a vertex, mesh units.
    pub largest: f32,
    /// The same on a human head, millimetres.
    pub largest_mm: f32,
    /// Whether anything moves visibly.
    pub present: bool,
    /// Why nothing moves, or which parts do not move along.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl ShapeReport {
    /// Reports on a shape `[V, 3]` in mesh units. `scale`: metres per unit on a human head. `note`
    /// receives whether the shape moves visibly.
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
