//! Parts the lips before a phrase, to breathe in.
//!
//! In the tracked face of grid_s1 the lips open by 4 to 6 mm over the half second before every
//! phrase. They close again in time if the phrase begins with p, b or m. Here they part less: the
//! opening that the model already makes stays, and only the missing part is added.

use ndarray::{Array3, ArrayView3};

use super::{
    face_modes::FaceModes,
    phrases::{Phrases, smooth_step},
};
use crate::{Result, audio::Prosody, mesh::ibug::speaking};

/// How far the inner lips part at strength 1, metres.
const PARTED_M: f32 = 2.0e-3;
/// The lips begin to part this long before the voice, and take this long to do so, seconds.
const BEFORE_S: f64 = 0.55;
const OPENING_S: f64 = 0.42;
/// How long they take to give way to speech, seconds.
const CLOSING_S: f64 = 0.12;
/// Lips with a smaller gap than this are closed, metres more than in the neutral face.
const CLOSED_M: f32 = 0.5e-3;
/// A closure this long before or after the start of a phrase belongs to it, seconds. The breath is
/// over this long (`FREE_S`) before the closure.
const CLOSURE_NEAR_S: (f64, f64) = (0.06, 0.2);
const FREE_S: f64 = 0.04;
/// A pause shorter than this brings no breath, seconds.
const PAUSE_S: f64 = 0.35;
const UPPER: usize = 62;
const LOWER: usize = 66;

/// One breath, seconds. The lips begin to part at the start and rest again at the end.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Breath {
    start_s: f64,
    end_s: f64,
}

impl Breath {
    /// How far the lips are parted, 0 to 1.
    fn at(&self, time_s: f64) -> f32 {
        let opening = (time_s - self.start_s) / OPENING_S;
        let closing = (self.end_s - time_s) / CLOSING_S;
        smooth_step(opening.min(closing)) as f32
    }
}

/// Parts the lips before phrases by up to `strength` times 2 mm, but never where they close.
///
/// `moved`: `[T, 68, 3]`, canonical metres. Closures are found in `sampled`, the same before
/// any control.
pub(super) fn breathe(
    moved: &mut Array3<f32>,
    sampled: ArrayView3<'_, f32>,
    fps: f64,
    prosody: &Prosody,
    modes: &FaceModes,
    strength: f32,
) -> Result<()> {
    let jaw = modes.mode("jawOpen")?;
    let opened_by_jaw = jaw[[UPPER, 1]] - jaw[[LOWER, 1]];
    let frames = moved.dim().0;
    for breath in breaths(prosody, sampled, fps) {
        let first = (breath.start_s * fps).ceil().max(0.0) as usize;
        let end = ((breath.end_s * fps).ceil().max(0.0) as usize).min(frames);
        for t in first.min(end)..end {
            let mut frame = moved.index_axis_mut(ndarray::Axis(0), t);
            let has = frame[[UPPER, 1]] - frame[[LOWER, 1]];
            let lacks = (PARTED_M - has.max(0.0)).max(0.0);
            let more = strength * breath.at(t as f64 / fps) * lacks / opened_by_jaw;
            for n in speaking() {
                frame.row_mut(n).scaled_add(more, &jaw.row(n));
            }
        }
    }
    Ok(())
}

/// One breath before each phrase that follows a long enough pause. It ends before a closure at the
/// start of the phrase.
fn breaths(prosody: &Prosody, sampled: ArrayView3<'_, f32>, fps: f64) -> Vec<Breath> {
    let frames = sampled.dim().0;
    let closed = |t: &usize| sampled[[*t, UPPER, 1]] - sampled[[*t, LOWER, 1]] < CLOSED_M;
    let phrases = Phrases::of(prosody).0;
    let breathed = phrases.iter().filter(|phrase| phrase.pause_s >= PAUSE_S);
    breathed
        .map(|phrase| {
            let at = |time_s: f64| (time_s.max(0.0) * fps) as usize;
            let near = at(phrase.start_s - CLOSURE_NEAR_S.0)
                ..at(phrase.start_s + CLOSURE_NEAR_S.1).min(frames);
            let closure_s = near.into_iter().find(closed).map(|t| t as f64 / fps);
            let before_s = phrase.start_s - phrase.pause_s;
            Breath {
                start_s: (phrase.start_s - BEFORE_S).max(before_s),
                end_s: closure_s.map_or(phrase.start_s + CLOSING_S, |s| s - FREE_S),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::phrases::tests::speaking as voice;

    const FPS: f64 = 50.0;

    /// Lips 6 mm apart during speech and shortly before, closed for 0.1 s from `closure_s` on, at rest
    /// in pauses.
    fn sampled(pause: usize, closure_s: Option<f64>) -> Array3<f32> {
        Array3::from_shape_fn((450, 68, 3), |(t, n, i)| {
            let time_s = t as f64 / FPS;
            let phase = time_s % 3.0;
            let spoken = phase < 3.0 - pause as f64 / 100.0 || phase > 2.93;
            let closed = closure_s.is_some_and(|from| (from..from + 0.1).contains(&time_s));
            let open = spoken && !closed;
            if n == LOWER && i == 1 && open {
                -6e-3
            } else {
                0.0
            }
        })
    }

    fn breathed(pause: usize, closure_s: Option<f64>) -> (Array3<f32>, Array3<f32>) {
        let (prosody, modes) = (voice(9, pause), FaceModes::open(None).unwrap());
        let before = sampled(pause, closure_s);
        let mut after = before.clone();
        breathe(&mut after, before.view(), FPS, &prosody, &modes, 1.0).unwrap();
        (before, after)
    }

    fn gap(moved: &Array3<f32>, time_s: f64) -> f32 {
        let t = (time_s * FPS).round() as usize;
        moved[[t, UPPER, 1]] - moved[[t, LOWER, 1]]
    }

    #[test]
    fn lips_part_before_a_phrase_and_nowhere_else() {
        let (before, after) = breathed(80, None);
        assert!((1.9e-3..2.1e-3).contains(&gap(&after, 2.9)));
        for time_s in [0.5, 1.5, 2.3, 4.0] {
            assert_eq!(gap(&before, time_s), gap(&after, time_s));
        }
    }

    #[test]
    fn short_pauses_bring_no_breath() {
        let (before, after) = breathed(30, None);
        assert_eq!(before, after);
    }

    #[test]
    fn a_closure_at_the_begin_stays_closed() {
        let (before, after) = breathed(80, Some(2.95));
        assert!(gap(&after, 2.7) > 1e-3);
        for time_s in [2.94, 2.96, 3.0, 3.04] {
            assert_eq!(gap(&before, time_s), gap(&after, time_s));
        }
    }
}
