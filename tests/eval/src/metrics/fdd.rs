//! FDD, upper-face dynamics deviation (Xing et al. 2023, CodeTalker).

use super::{Clip, check};
use anyface::Result;

/// How much less (positive) or more (negative) the upper face moves than in truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fdd {
    /// `mean_v std_t(‖G‖²) − mean_v std_t(‖P‖²)`.
    pub signed: f64,
    /// Its magnitude.
    pub absolute: f64,
}

/// FDD over `upper`; both clips are displacements from the neutral face. Population deviation.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn face_dynamics_deviation(
    prediction: Clip<'_>,
    truth: Clip<'_>,
    upper: &[usize],
) -> Result<Fdd> {
    check(prediction, truth, upper, 1)?;
    let mean = |clip| upper.iter().map(|v| deviation(clip, *v)).sum::<f64>() / upper.len() as f64;
    let signed = match upper.is_empty() {
        true => 0.0,
        false => mean(truth) - mean(prediction),
    };
    Ok(Fdd {
        signed,
        absolute: signed.abs(),
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
