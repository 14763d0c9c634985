//! DTW, dynamic time warping distance of the lips (Sakoe & Chiba 1978).

use super::{Clip, check, frame_distance};
use crate::Result;

/// Smallest sum of frame distances along any monotone path from the first to the last frames.
///
/// A frame is the lips' coordinates as one vector; steps (1,0), (0,1) and (1,1) weigh the same.
/// Cost T² distances, memory T.
///
/// # Errors
/// `ShapeMismatch` unless both are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn dynamic_time_warping(prediction: Clip<'_>, truth: Clip<'_>, lips: &[usize]) -> Result<f64> {
    check(prediction, truth, lips, 1)?;
    let frames = truth.dim().0;
    let mut before = vec![f64::INFINITY; frames + 1];
    before[0] = 0.0;
    for t in 0..frames {
        let mut row = vec![f64::INFINITY; frames + 1];
        for s in 0..frames {
            let cheapest = before[s].min(before[s + 1]).min(row[s]);
            row[s + 1] = cheapest + frame_distance(prediction, t, truth, s, lips);
        }
        before = row;
    }
    Ok(before[frames])
}
