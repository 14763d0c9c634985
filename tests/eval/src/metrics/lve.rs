//! LVE, lip vertex error (Richard et al. 2021, MeshTalk).

use super::{Clip, mean_of_largest};
use anyface::Result;

/// `mean_t max_{v ∈ lips} ‖P − G‖²`.
///
/// The square root of the result is in the clip's own unit and is what a reader can picture;
/// "×1e-5 mm" in the literature is this squared distance in m².
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn lip_vertex_error(prediction: Clip<'_>, truth: Clip<'_>, lips: &[usize]) -> Result<f64> {
    mean_of_largest(prediction, truth, lips)
}
