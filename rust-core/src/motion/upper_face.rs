//! Motion of the brows, lids and bridge of the nose, and asymmetry between the sides of the face.

use ndarray::{Array3, ArrayView2, ArrayViewMut2};

use super::FaceModes;
use crate::Result;
use crate::mesh::ibug::{EYES, Eye, SIDES, upper_face};

/// The share of motion that an extreme `asymmetry` adds to one side and takes from the other.
const MAX_LOPSIDED: f32 = 0.5;
/// The share of the upper lid's motion that the lower lid makes when the eyes look down, as in the
/// tracked face of grid_s1.
const LOWER_LID_SHARE: f32 = 0.12;

/// How far a brow moves up on a human head, metres: freely as far as the first value, never beyond
/// the second.
const BROW_UP_M: (f32, f32) = (0.009, 0.014);
/// The same for down.
const BROW_DOWN_M: (f32, f32) = (0.005, 0.0095);
/// The same for the motion towards the other brow.
const BROW_IN_M: (f32, f32) = (0.0025, 0.004);
/// The same for lids that open wider than at rest, as shares of their opening at rest.
const WIDE: (f32, f32) = (0.25, 0.5);

/// Keeps brows and wide lids within what a face can do, however many motions are added up.
///
/// `moved`: `[T, 68, 3]`, canonical metres.
pub(super) fn limit(moved: &mut Array3<f32>, modes: &FaceModes) -> Result<()> {
    let eyes = lids(modes)?;
    for mut frame in moved.outer_iter_mut() {
        limit_frame(&mut frame, &eyes);
    }
    Ok(())
}

/// The same for one frame `[68, 3]`.
pub(super) fn limit_frame(frame: &mut ArrayViewMut2<'_, f32>, eyes: &[Lids<'_>; 2]) {
    for (lids, inward) in eyes.iter().zip([1.0, -1.0]) {
        for n in lids.eye.brow.clone() {
            let [x, y] = [inward * frame[[n, 0]], frame[[n, 1]]];
            frame[[n, 0]] = inward * up_to(x, BROW_IN_M);
            frame[[n, 1]] = -up_to(-up_to(y, BROW_UP_M), BROW_DOWN_M);
        }
        let wide = -lids.closure(frame);
        lids.close(frame, wide - up_to(wide, WIDE));
    }
}

/// Leaves `x` unchanged up to the first bound. Beyond it the value approaches the second bound.
fn up_to(x: f32, (free, most): (f32, f32)) -> f32 {
    if x > free {
        free + (most - free) * ((x - free) / (most - free)).tanh()
    } else {
        x
    }
}

/// Scales the motion of the upper face. Lids that would pass through each other just close.
///
/// `moved`: `[T, 68, 3]`, canonical metres.
pub(super) fn scale(moved: &mut Array3<f32>, modes: &FaceModes, factor: f32) -> Result<()> {
    let eyes = lids(modes)?;
    for mut frame in moved.outer_iter_mut() {
        let most: [f32; 2] = std::array::from_fn(|e| eyes[e].closure(&frame).max(1.0));
        for n in upper_face() {
            frame.row_mut(n).map_inplace(|x| *x *= factor);
        }
        for (eye, most) in eyes.iter().zip(most) {
            let excess = eye.closure(&frame) - most;
            if excess > 0.0 {
                eye.close(&mut frame, -excess);
            }
        }
    }
    Ok(())
}

/// Makes the motion of brows and mouth corners larger on one side and smaller on the other.
pub(super) fn lean(moved: &mut Array3<f32>, asymmetry: f32) {
    for mut frame in moved.outer_iter_mut() {
        for (right, left, share) in SIDES {
            let more = MAX_LOPSIDED * asymmetry * share;
            frame.row_mut(right).map_inplace(|x| *x *= 1.0 - more);
            frame.row_mut(left).map_inplace(|x| *x *= 1.0 + more);
        }
    }
}

/// The lids of one eye, with the motion that closes them.
pub(super) struct Lids<'a> {
    eye: &'static Eye,
    mode: ArrayView2<'a, f32>,
}

/// The lids of both eyes, the subject's right one first.
pub(super) fn lids(modes: &FaceModes) -> Result<[Lids<'_>; 2]> {
    let [right, left] = &EYES;
    Ok([Lids::of(right, modes)?, Lids::of(left, modes)?])
}

impl<'a> Lids<'a> {
    fn of(eye: &'static Eye, modes: &'a FaceModes) -> Result<Self> {
        let mode = modes.mode(eye.mode)?;
        Ok(Lids { eye, mode })
    }

    /// How far the lids are closed: 0 is neutral, 1 as closed as the full mode, below 0 wide open.
    pub(super) fn closure(&self, frame: &impl std::ops::Index<[usize; 2], Output = f32>) -> f32 {
        let gap = |(up, low): (usize, usize)| frame[[up, 1]] - frame[[low, 1]];
        let full = |(up, low): (usize, usize)| self.mode[[up, 1]] - self.mode[[low, 1]];
        let [a, b] = self.eye.pairs;
        (gap(a) + gap(b)) / (full(a) + full(b))
    }

    /// Limits how far the gap of one lid pair may differ from an even closing to `most`, metres, so
    /// that a blink closes both pairs. The mean gap stays.
    pub(super) fn even(&self, frame: &mut ArrayViewMut2<'_, f32>, most: f32) {
        let closure = self.closure(frame);
        let [(up, low), (other, _)] = self.eye.pairs;
        let even_gap = closure * (self.mode[[up, 1]] - self.mode[[low, 1]]);
        let ahead = frame[[up, 1]] - frame[[low, 1]] - even_gap;
        let excess = ahead - ahead.clamp(-most, most);
        frame[[up, 1]] -= excess;
        frame[[other, 1]] += excess;
    }

    /// Moves the upper lid forward, out of the face, by `by` metres.
    pub(super) fn bring_forward(&self, frame: &mut ArrayViewMut2<'_, f32>, by: f32) {
        for (upper, _) in self.eye.pairs {
            frame[[upper, 2]] += by;
        }
    }

    /// Lowers the upper lid by `down` metres along the path of a blink, and the lower lid by a
    /// little. The more the lids are closed, the less they move.
    pub(super) fn follow(&self, frame: &mut ArrayViewMut2<'_, f32>, down: f32) {
        let open = (1.0 - self.closure(frame)).clamp(0.0, 1.0);
        for (upper, lower) in self.eye.pairs {
            let way = self.mode.row(upper);
            let weight = open * down / -way[1];
            frame.row_mut(upper).scaled_add(weight, &way);
            frame[[lower, 1]] -= LOWER_LID_SHARE * open * down;
        }
    }

    /// Adds the closing mode with `weight` to the lids and to nothing else.
    pub(super) fn close(&self, frame: &mut ArrayViewMut2<'_, f32>, weight: f32) {
        for n in self.eye.lids.clone() {
            frame.row_mut(n).scaled_add(weight, &self.mode.row(n));
        }
    }
}
