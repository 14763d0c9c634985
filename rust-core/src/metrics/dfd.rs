//! DFD, discrete Fréchet distance of the lips (Eiter & Mannila 1994).

use super::{Clip, check, frame_distance};
use crate::Result;

/// Smallest leash on which both can walk from their first to their last frames, never backwards.
///
/// A frame is the lips' coordinates as one vector. Cost T² distances, memory T.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn discrete_frechet_distance(
    prediction: Clip<'_>,
    truth: Clip<'_>,
    lips: &[usize],
) -> Result<f64> {
    check(prediction, truth, lips, 1)?;
    let frames = truth.dim().0;
    let mut before = vec![f64::INFINITY; frames + 1];
    before[0] = 0.0;
    for t in 0..frames {
        let mut row = vec![f64::INFINITY; frames + 1];
        for s in 0..frames {
            let shortest = before[s].min(before[s + 1]).min(row[s]);
            row[s + 1] = shortest.max(frame_distance(prediction, t, truth, s, lips));
        }
        before = row;
    }
    Ok(before[frames])
}
