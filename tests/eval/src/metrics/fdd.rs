//! FDD, upper-face dynamics deviation (Xing et al. 2023, CodeTalker).

use super::{Clip, check};
use anyface::Result;

/// Signed FDD over `upper`, `mean_v std_t(‖G‖²) − mean_v std_t(‖P‖²)`.
///
/// Positive where the upper face moves less than in truth, negative where it moves more. Both clips
/// hold displacements from the neutral face. The standard deviation is that of a population.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn face_dynamics_deviation(
    prediction: Clip<'_>,
    truth: Clip<'_>,
    upper: &[usize],
) -> Result<f64> {
    check(prediction, truth, upper, 1)?;
    let mean = |clip| upper.iter().map(|v| deviation(clip, *v)).sum::<f64>() / upper.len() as f64;
    Ok(if upper.is_empty() {
        0.0
    } else {
        mean(truth) - mean(prediction)
    })
}

/// Standard deviation over time of the squared displacement of one vertex.
fn deviation(clip: Clip<'_>, v: usize) -> f64 {
    let frames = clip.dim().0;
    let motion: Vec<f64> = (0..frames)
        .map(|t| (0..3).map(|i| clip[[t, v, i]].powi(2)).sum())
        .collect();
    let mean = motion.iter().sum::<f64>() / frames as f64;
    let variance = motion.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / frames as f64;
    variance.sqrt()
}
