//! MVE, mean vertex error.

use super::{Clip, check, squared_distance};
use anyface::Result;

/// `mean_{t, v} ‖P − G‖`, in the clip's unit.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`.
pub fn mean_vertex_error(prediction: Clip<'_>, truth: Clip<'_>) -> Result<f64> {
    check(prediction, truth, &[], 1)?;
    let (frames, vertices, _) = truth.dim();
    let mut sum = 0.0;
    for t in 0..frames {
        for v in 0..vertices {
            sum += squared_distance(prediction, truth, t, v).sqrt();
        }
    }
    Ok(sum / (frames * vertices) as f64)
}
