//! Scales what speech does to jaw, rounding and width of the mouth. Lips that met still meet.

use ndarray::{Array3, ArrayView2, ArrayView3, ArrayViewMut2};

use super::{
    FaceModes,
    contacts::{TOUCHING_M, forward, opening, restore_contacts},
};
use crate::{
    Result,
    mesh::ibug::{CHIN, CORNERS, LIP_COLUMNS, speaking},
};

/// Lips begin to close below this gap, metres more than in the neutral face.
const CLOSED_M: f32 = 1.5e-3;
/// How strongly each part of speech moves the mouth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mouth<'a> {
    /// `[T]`, the gain on all speech motion.
    pub(super) articulation: &'a [f32],
    pub(super) jaw: f32,
    pub(super) rounding: f32,
    pub(super) width: f32,
}

impl Mouth<'_> {
    /// Whether all gains are 1, so that speech stays as it is.
    pub(super) fn is_neutral(&self) -> bool {
        let parts = [self.jaw, self.rounding, self.width];
        parts
            .iter()
            .chain(self.articulation)
            .all(|gain| *gain == 1.0)
    }
}

/// Scales speech around the emotion's expression.
///
/// Speech is `jaw + rounding + width + rest`. The jaw's part is the `jawOpen` that drops the chin as
/// far as speech does. Rounding is the `mouthPucker` that brings the lips as far forward as speech
/// without the jaw does. Width is the `mouthStretch` of both sides that parts the corners as far as
/// the remaining motion does.
///
/// # Shapes and units
/// `moved`, `emotion`: `[T, 68, 3]`, canonical metres.
///
/// # Errors
/// `Weights` for modes without these shapes.
pub(super) fn articulate(
    moved: &mut Array3<f32>,
    emotion: ArrayView3<'_, f32>,
    modes: &FaceModes,
    mouth: &Mouth<'_>,
) -> Result<()> {
    let (jaw, pucker) = (modes.mode("jawOpen")?, modes.mode("mouthPucker")?);
    let stretch = &modes.mode("mouthStretch_L")? + &modes.mode("mouthStretch_R")?;
    let frames = moved.outer_iter_mut().zip(emotion.outer_iter());
    for ((mut frame, emotion), articulation) in frames.zip(mouth.articulation) {
        let speech = &frame - &emotion;
        let opening = speech[[CHIN, 1]] / jaw[[CHIN, 1]];
        let lips = &speech - &(opening * &jaw);
        let rounding = (forward(lips.view()) / forward(pucker)).max(0.0);
        let rest = &lips - &(rounding * &pucker);
        let width = width_of(rest.view()) / width_of(stretch.view());
        for n in speaking() {
            for axis in 0..3 {
                let at = [n, axis];
                let more = (mouth.jaw - 1.0) * opening * jaw[at]
                    + (mouth.rounding - 1.0) * rounding * pucker[at]
                    + (mouth.width - 1.0) * width * stretch[at];
                frame[at] = emotion[at] + articulation * (speech[at] + more);
            }
        }
    }
    Ok(())
}

/// Distance between the corners of the mouth, metres more than in the neutral face.
fn width_of(face: ArrayView2<'_, f32>) -> f32 {
    let [right, left] = CORNERS;
    face[[left, 0]] - face[[right, 0]]
}

/// Gives closed lips their gap back. Lips that are closed in `sampled` are closed in `moved`, and
/// they overlap no deeper than before.
///
/// Closing fades in over the last 1.5 mm. Around closed lips the gap stays on the path that lips
/// take ([`restore_contacts`]), so that nothing jumps. Both `[T, 68, 3]`, canonical metres.
pub(super) fn keep_closures(moved: &mut Array3<f32>, sampled: ArrayView3<'_, f32>, fps: f64) {
    for (mut frame, sampled) in moved.outer_iter_mut().zip(sampled.outer_iter()) {
        keep_gap(&mut frame, sampled, closedness, 0.0);
    }
    let openings: Vec<f32> = sampled.outer_iter().map(opening).collect();
    keep_path(moved, &openings, fps);
}

/// Keeps the lips of `moved` `[T, 68, 3]` on their path to and from contacts
/// ([`restore_contacts`]). `before` `[T]`: how far the lips were from touching, metres.
pub(super) fn keep_path(moved: &mut Array3<f32>, before: &[f32], fps: f64) {
    let openings: Vec<f32> = moved.outer_iter().map(|face| opening(face)).collect();
    let shares = restore_contacts(&openings, before, fps);
    let frames = moved.outer_iter_mut().zip(shares);
    for (mut frame, share) in frames.filter(|(_, share)| *share > 0.0) {
        for column in &LIP_COLUMNS {
            let opening = column.gap(frame.view()) - TOUCHING_M;
            column.part(&mut frame, -share * opening.max(0.0));
        }
    }
}

/// How nearly lips are closed, 0 to 1. `gap`: metres more than in the neutral face.
pub(super) fn closedness(gap: f32) -> f32 {
    (1.0 - gap / CLOSED_M).clamp(0.0, 1.0)
}

/// Moves the lips of a frame towards the gap `had` that they have in `sampled`, by the share
/// `closed(had)` of the way. A gap below both `had` and `least` is first raised to the smaller one.
pub(super) fn keep_gap(
    frame: &mut ArrayViewMut2<'_, f32>,
    sampled: ArrayView2<'_, f32>,
    closed: impl Fn(f32) -> f32,
    least: f32,
) {
    for column in &LIP_COLUMNS {
        let (had, has) = (column.gap(sampled), column.gap(frame.view()));
        let free = has.max(had.min(least));
        column.part(frame, free + closed(had) * (had - free) - has);
    }
}
