//! Finds the weights of one frame that bring points of a face to their goals: least squares with
//! bounds.

use ndarray::{Array2, ArrayView1, ArrayView3, ArrayViewMut1};

/// Changing a weight by 1 costs as much as an aim whose squared miss is this many square
/// millimetres.
const PRICE: f32 = 0.05;
/// Moving a corner of the mouth by a millimetre costs as much as an aim whose squared miss is this
/// many square millimetres. The cost keeps a smile while the lips close for an m.
const HOLD: f32 = 0.02;
/// The most sweeps over the moving shapes. After these the weights have settled.
const SWEEPS: usize = 30;
/// The corners of the mouth.
const CORNERS: [usize; 2] = [48, 54];
const MM: f32 = 1e3;

/// A length in a frame (the sum of `by` times the weights) and the goal for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aim<'a> {
    /// `[S]`, the length that each shape adds at weight 1, metres.
    pub by: ArrayView1<'a, f32>,
    /// The length to reach, metres.
    pub goal: f32,
    /// How far below the goal the length may stay, metres.
    pub slack: f32,
}

impl Aim<'_> {
    /// How far a length that is `off_mm` from the goal misses it beyond the slack; both in
    /// millimetres.
    fn missed_mm(&self, off_mm: f32) -> f32 {
        if off_mm <= 0.0 {
            (off_mm + MM * self.slack).min(0.0)
        } else {
            off_mm
        }
    }
}

/// How far each shape at weight 1 moves the corners of the mouth, `[S, 6]` metres. `shapes`:
/// landmarks `[S, 68, 3]`.
pub(super) fn corners_of(shapes: ArrayView3<'_, f32>) -> Array2<f32> {
    let corner = |(s, i): (usize, usize)| shapes[[s, CORNERS[i / 3], i % 3]];
    Array2::from_shape_fn((shapes.dim().0, 3 * CORNERS.len()), corner)
}

/// Changes the weights `[S]` of a frame as little as possible so that they meet the `aims`. Each
/// weight of `moving` stays between 0 and its maximum. `fixed`: `[S, K]`, metres: how much each
/// shape at weight 1 changes lengths that should stay the same. Coordinate descent, as in
/// [`crate::rig::solve`].
pub(super) fn reach(
    weights: &mut ArrayViewMut1<'_, f32>,
    aims: &[Aim<'_>],
    fixed: &Array2<f32>,
    moving: &[(usize, f32)],
) {
    let start = weights.to_owned();
    // The distance of each length from its goal and the drift of each fixed length, in millimetres.
    // Every step updates both. Recomputing these sums over all shapes at each step took more than
    // half of the time of a job.
    let from_goal = |aim: &Aim<'_>| MM * (weights.dot(&aim.by) - aim.goal);
    let mut off: Vec<f32> = aims.iter().map(from_goal).collect();
    let mut drift = vec![0.0; fixed.ncols()];
    for _ in 0..SWEEPS {
        let mut has_moved = false;
        for &(s, most) in moving {
            let mut pull = PRICE * (weights[s] - start[s]);
            let mut slope = PRICE;
            for (by, drift) in fixed.row(s).iter().zip(&drift) {
                pull += HOLD * MM * by * drift;
                slope += HOLD * MM * by * MM * by;
            }
            for (aim, off) in aims.iter().zip(&off) {
                let (by, missed) = (MM * aim.by[s], aim.missed_mm(*off));
                if missed != 0.0 {
                    pull += by * missed;
                    slope += by * by;
                }
            }
            let best = (weights[s] - pull / slope).clamp(0.0, most);
            let step = MM * (best - weights[s]);
            weights[s] = best;
            has_moved |= step != 0.0;
            off.iter_mut()
                .zip(aims)
                .for_each(|(off, aim)| *off += step * aim.by[s]);
            drift
                .iter_mut()
                .zip(fixed.row(s))
                .for_each(|(drift, by)| *drift += step * by);
        }
        if !has_moved {
            break;
        }
    }
}
