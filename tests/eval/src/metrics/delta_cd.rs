//! δCd, the difference between the directions of motion from frame to frame.

use super::{Clip, check};
use anyface::Result;

/// Product of lengths below which a direction is undefined.
const SMALLEST: f64 = 1e-24;

/// `mean_{t, v} (1 − cos(ΔP, ΔG))`, 0 to 2; a vertex that does not move counts as 1, a right angle.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]` with at least two frames.
pub fn delta_cd(prediction: Clip<'_>, truth: Clip<'_>) -> Result<f64> {
    check(prediction, truth, &[], 2)?;
    let (frames, vertices, _) = truth.dim();
    let mut sum = 0.0;
    for t in 0..frames - 1 {
        for v in 0..vertices {
            let step = |clip: Clip<'_>| [0, 1, 2].map(|i| clip[[t + 1, v, i]] - clip[[t, v, i]]);
            let (p, g) = (step(prediction), step(truth));
            let dot: f64 = (0..3).map(|i| p[i] * g[i]).sum();
            let length = |x: [f64; 3]| x.iter().map(|c| c * c).sum::<f64>().sqrt();
            sum += 1.0 - dot / (length(p) * length(g)).max(SMALLEST);
        }
    }
    Ok(sum / ((frames - 1) * vertices) as f64)
}
