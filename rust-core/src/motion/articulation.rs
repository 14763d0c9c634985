//! How strongly the mouth speaks, and whether jaw or lips do it; lips that met still meet.

use ndarray::{Array3, ArrayView2, ArrayView3, ArrayViewMut2};

use super::contacts::{TOUCHING_M, opening, restore_contacts};
use crate::mesh::ibug::{CHIN, LIP_COLUMNS, LipColumn, speaking};

/// Lips nearer than this over neutral count as closing, metres.
const CLOSED_M: f32 = 1.5e-3;
/// Share that the extremes of `jaw_lips` take from one and give to the other.
const MOST_SHIFTED: f32 = 0.5;

/// Scales speech around the emotion's expression: `emotion + a ((1 + b) jaw + (1 − b) lips)`.
///
/// `articulation` `[T]` is `a` of each frame. The jaw's part is the chin's drop over the emotion times `jaw_open`, scaled to a chin that drops by
/// one; the lips' part is the rest. `b` is half of `jaw_lips`.
///
/// # Shapes and units
/// `moved`, `emotion`: `[T, 68, 3]`, canonical metres. `jaw_open`: `[68, 3]`.
pub(super) fn articulate(
    moved: &mut Array3<f32>,
    emotion: ArrayView3<'_, f32>,
    jaw_open: ArrayView2<'_, f32>,
    articulation: &[f32],
    jaw_lips: f32,
) {
    let shift = MOST_SHIFTED * jaw_lips;
    let reach = jaw_open[[CHIN, 1]];
    let frames = moved.outer_iter_mut().zip(emotion.outer_iter());
    for ((mut frame, emotion), articulation) in frames.zip(articulation) {
        let opening = (frame[[CHIN, 1]] - emotion[[CHIN, 1]]) / reach;
        for n in speaking() {
            for axis in 0..3 {
                let speech = frame[[n, axis]] - emotion[[n, axis]];
                let jaw = opening * jaw_open[[n, axis]];
                let shifted = (1.0 + shift) * jaw + (1.0 - shift) * (speech - jaw);
                frame[[n, axis]] = emotion[[n, axis]] + articulation * shifted;
            }
        }
    }
}

/// Gives closed lips their gap back: what was closed in `sampled` is closed in `moved`, and lips pass
/// no deeper through one another than they did.
///
/// Closing fades in over the last 1.5 mm, and around closed lips the gap stays on the path that lips take
/// ([`restore_contacts`]), so that nothing jumps. Both `[T, 68, 3]`, canonical metres.
pub(super) fn keep_closures(moved: &mut Array3<f32>, sampled: ArrayView3<'_, f32>, fps: f64) {
    for (mut frame, sampled) in moved.outer_iter_mut().zip(sampled.outer_iter()) {
        keep_gap(&mut frame, sampled, closedness, 0.0);
    }
    let openings = |clip: ArrayView3<'_, f32>| clip.outer_iter().map(opening).collect::<Vec<f32>>();
    let shares = restore_contacts(&openings(moved.view()), &openings(sampled), fps);
    let frames = moved.outer_iter_mut().zip(shares);
    for (mut frame, share) in frames.filter(|(_, share)| *share > 0.0) {
        for column in &LIP_COLUMNS {
            let (up, low) = (column.upper[0].0, column.lower[0].0);
            let opening = frame[[up, 1]] - frame[[low, 1]] - TOUCHING_M;
            part(&mut frame, column, -share * opening.max(0.0));
        }
    }
}

/// Parts the lips of a column by so much, metres: each goes half of the way, and the outer lip with the inner one.
fn part(frame: &mut ArrayViewMut2<'_, f32>, column: &LipColumn, by: f32) {
    for (n, share) in column.upper {
        frame[[*n, 1]] += 0.5 * share * by;
    }
    for (n, share) in column.lower {
        frame[[*n, 1]] -= 0.5 * share * by;
    }
}

/// How nearly lips are closed at a gap over that of the neutral face, metres: 0 to 1.
pub(super) fn closedness(gap: f32) -> f32 {
    (1.0 - gap / CLOSED_M).clamp(0.0, 1.0)
}

/// Moves the lips of a frame the part `closed(had)` of the way to the gap that they had, and further
/// where they lie deeper in one another than they did, and than `least`.
pub(super) fn keep_gap(
    frame: &mut ArrayViewMut2<'_, f32>,
    sampled: ArrayView2<'_, f32>,
    closed: impl Fn(f32) -> f32,
    least: f32,
) {
    for column in &LIP_COLUMNS {
        let (up, low) = (column.upper[0].0, column.lower[0].0);
        let had = sampled[[up, 1]] - sampled[[low, 1]];
        let has = frame[[up, 1]] - frame[[low, 1]];
        let free = has.max(had.min(least));
        part(frame, column, free + closed(had) * (had - free) - has);
    }
}
