//! Adds an expression to neutral speech.

use ndarray::{ArrayView2, ArrayViewMut2};

use super::{
    dynamics::{Wandering, accent_at, accents, region},
    lips::{self, Closures},
    table::Expressions,
};
use crate::{
    Result,
    conditions::{EMOTIONS, Strengths},
    motion::{
        Cues, FaceModes, LandmarkClip,
        articulation::keep_path,
        contacts::opening,
        upper_face::{Lids, lids},
    },
};

/// Standard deviation of the smoothing that slurs speech, seconds.
pub(super) const SLUR_S: f64 = 0.08;
/// Share of an expression's parting of the lips that a closure takes away.
const YIELD: f32 = 0.7;
/// An expression closes the lids in proportion up to the first bound, then ever less, and never beyond
/// the second. A blink closes the rest.
const LIDS_LINEAR: f32 = 0.65;
const LIDS_MOST: f32 = 0.9;

/// The most by which one end of an eye may be ahead of the other as an expression closes it, metres.
const UNEVEN_M: f32 = 0.25e-3;

/// Added to the opening of resting lips, metres, so that an expression may part them.
const AT_REST_M: f32 = 0.1;

/// Everything about one frame that an expression needs.
pub(super) struct Moment {
    pub(super) strengths: Strengths,
    /// Factors on the regions of the face.
    pub(super) regions: [f32; 4],
    /// 1 at a closure.
    pub(super) yielding: f32,
    /// 0 where the lips rest.
    pub(super) speaking: f32,
}

impl Expressions {
    /// Adds the expression of `cues` to motion that speaks neutrally. If the whole clip is neutral, no
    /// bit changes. `onset`: factor on the times in which emotions come and go.
    ///
    /// # Errors
    /// `Weights` where `modes` lack the lids.
    pub fn add(
        &self,
        clip: &mut LandmarkClip,
        cues: &Cues<'_>,
        modes: &FaceModes,
        onset: f32,
    ) -> Result<()> {
        let fps = clip.fps;
        let strengths = self.followed(cues.affect, fps, onset);
        if !strengths.iter().any(is_shown) {
            return Ok(());
        }
        let smooth = clip.smoothed(SLUR_S).displacements;
        let closures = Closures::of(&clip.displacements, fps);
        let (eyes, accents) = (lids(modes)?, accents(cues.prosody));
        let mut wandering = Wandering::new(cues.seed);
        let spoken = clip.displacements.outer_iter();
        let openings = spoken
            .zip(&closures.speaking)
            .map(|(face, speaking)| opening(face) + (1.0 - speaking) * AT_REST_M);
        let openings: Vec<f32> = openings.collect();
        let frames = clip.displacements.outer_iter_mut().zip(smooth.outer_iter());
        for (t, (mut frame, smooth)) in frames.enumerate() {
            let time_s = t as f64 / fps;
            let accent = accent_at(&accents, time_s);
            let moment = Moment {
                strengths: strengths[t],
                regions: wandering.at(time_s).map(|factor| factor + accent),
                yielding: closures.yielding[t],
                speaking: closures.speaking[t],
            };
            self.show(&mut frame, smooth, &moment, &eyes);
        }
        keep_path(&mut clip.displacements, &openings, fps);
        Ok(())
    }

    /// Shows the expression in one frame: changes the manner of speaking, displaces the landmarks, and
    /// keeps lips and lids from passing through each other.
    ///
    /// `frame`, `smooth`: `[68, 3]`, canonical metres, as spoken and smoothed over time.
    pub(super) fn show(
        &self,
        frame: &mut ArrayViewMut2<'_, f32>,
        smooth: ArrayView2<'_, f32>,
        moment: &Moment,
        eyes: &[Lids<'_>; 2],
    ) {
        if !is_shown(&moment.strengths) {
            return;
        }
        let spoken = frame.to_owned();
        let manner = self.manner(&moment.strengths);
        manner.speak(frame, smooth, 1.0 - moment.yielding);
        self.displace(frame, moment);
        lips::hold(frame, spoken.view(), moment.speaking);
        for eye in eyes {
            let (was, is) = (eye.closure(&spoken), eye.closure(frame));
            let most = bent(is).max(was);
            if is > most {
                eye.close(frame, most - is);
            }
            eye.even(frame, UNEVEN_M);
        }
    }

    fn displace(&self, frame: &mut ArrayViewMut2<'_, f32>, moment: &Moment) {
        let free = 1.0 - YIELD * moment.yielding;
        for e in 1..EMOTIONS.len() {
            let strength = moment.strengths[e];
            if strength == 0.0 {
                continue;
            }
            for ((n, axis), x) in frame.indexed_iter_mut() {
                let moved =
                    self.lasting[[e, 3 * n + axis]] + free * self.opening[[e, 3 * n + axis]];
                *x += strength * moment.regions[region(n)] * moved;
            }
        }
    }
}

fn is_shown(strengths: &Strengths) -> bool {
    strengths[1..].iter().any(|strength| *strength > 0.0)
}

/// Bends a closure of the lids (1: they meet) so that it never exceeds [`LIDS_MOST`].
fn bent(closure: f32) -> f32 {
    let room = LIDS_MOST - LIDS_LINEAR;
    if closure > LIDS_LINEAR {
        LIDS_LINEAR + room * ((closure - LIDS_LINEAR) / room).tanh()
    } else {
        closure
    }
}
