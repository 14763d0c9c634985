//! LVE, lip vertex error (Richard et al. 2021, MeshTalk).

use super::{Clip, check, squared_distance};
use anyface::Result;

/// `mean_t max_{v ∈ lips} ‖P − G‖²`.
///
/// The square root of the result is in the clip's own unit and is easier to picture. Where the
/// literature writes "×1e-5 mm", it means this squared distance in m².
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn lip_vertex_error(prediction: Clip<'_>, truth: Clip<'_>, lips: &[usize]) -> Result<f64> {
    check(prediction, truth, lips, 1)?;
    let frames = truth.dim().0;
    let largest = |t| {
        lips.iter().fold(0.0f64, |most, v| {
            most.max(squared_distance(prediction, truth, t, *v))
        })
    };
    Ok((0..frames).map(largest).sum::<f64>() / frames as f64)
}
