//! How tongue, lips and jaw move from one target to the next.

use ndarray::{Array2, ArrayView2};

/// The first row of posteriors of a frame lies this many seconds before the encoder's frame.
pub(super) const EARLY_S: f64 = 0.02;
/// A movement begins where its phones have the first probability in sum, and is complete from the
/// second.
const SURE: [f32; 2] = [0.15, 0.5];

/// How far a movement goes whose phones have this probability in sum, 0 to 1.
pub(super) fn sure(probability: f32) -> f32 {
    let [from, to] = SURE;
    ((probability - from) / (to - from)).clamp(0.0, 1.0)
}

/// Moves through `targets` `[R, N]` and returns the motion, `[frames, N]`. It starts `travel_s`
/// seconds before each target, to be there in time, and leaves it just as slowly. Where several
/// targets are near, the largest counts.
pub(super) fn travel(
    targets: ArrayView2<'_, f32>,
    rate_hz: f64,
    travel_s: f64,
    frames: usize,
    fps: f64,
) -> Array2<f32> {
    let mut out = Array2::zeros((frames, targets.ncols()));
    for (t, mut now) in out.outer_iter_mut().enumerate() {
        let middle = (t as f64 / fps + EARLY_S) * rate_hz;
        let reach = travel_s * rate_hz;
        let first = (middle - reach).ceil().max(0.0) as usize;
        let end = ((middle + reach).floor().max(0.0) as usize + 1).min(targets.nrows());
        for r in first.min(end)..end {
            let away = (r as f64 - middle).abs() / reach;
            let share = (0.5 + 0.5 * (std::f64::consts::PI * away.min(1.0)).cos()) as f32;
            for (x, target) in now.iter_mut().zip(targets.row(r)) {
                *x = f32::max(*x, share * target);
            }
        }
    }
    out
}
