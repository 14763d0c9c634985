//! δM, difference of motion between consecutive frames.

use super::{Clip, mean_over_steps};
use crate::Result;

/// `mean_{t, v} ‖ΔP − ΔG‖²`, with Δ the change to the next frame.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]` with at least two frames.
pub fn delta_m(prediction: Clip<'_>, truth: Clip<'_>) -> Result<f64> {
    mean_over_steps(prediction, truth, |p, g| {
        (0..3).map(|i| (p[i] - g[i]).powi(2)).sum()
    })
}
