//! EVE, eye vertex error: LVE's formula over the eyes and the forehead.

use super::{Clip, mean_of_largest};
use crate::Result;

/// `mean_t max_{v ∈ upper} ‖P − G‖²`, with `upper` the eyes and the forehead.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn eye_vertex_error(prediction: Clip<'_>, truth: Clip<'_>, upper: &[usize]) -> Result<f64> {
    mean_of_largest(prediction, truth, upper)
}
