//! The mouth comes to rest where nobody speaks.

use super::{
    LandmarkClip,
    phrases::{Phrases, smooth_step},
};
use crate::{audio::Prosody, mesh::ibug::speaking};

/// So long before and after speech the mouth moves as the network says; in so long it comes to rest, seconds.
const NEAR_S: f64 = 0.2;
const SETTLE_S: f64 = 0.5;

impl LandmarkClip {
    /// Brings jaw and lips to rest in pauses, `strength` `[T]` of the emotion that stays on them: at 1 nothing
    /// changes. Pauses within half a second of speech on both sides hardly change.
    pub(crate) fn rest_in_silence(&mut self, prosody: &Prosody, strength: &[f32]) {
        let phrases = Phrases::of(prosody);
        let mut frames = self.displacements.outer_iter_mut();
        for (t, strength) in strength.iter().enumerate() {
            let Some(mut frame) = frames.next() else {
                return;
            };
            let away_s = phrases.away_s(t as f64 / self.fps) - NEAR_S;
            let rest = smooth_step(away_s / SETTLE_S) as f32 * (1.0 - strength.clamp(0.0, 1.0));
            if rest > 0.0 {
                speaking().for_each(|n| frame.row_mut(n).map_inplace(|x| *x *= 1.0 - rest));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::motion::phrases::tests::speaking as voice;

    #[test]
    fn a_mouth_that_stands_open_closes_in_a_long_pause_and_under_an_emotion_it_stays() {
        // Three seconds, the last of them silent.
        let prosody = voice(3, 100);
        let open = Array3::from_elem((90, 68, 3), 2e-3);
        let rested = |strength: f32| {
            let mut clip = LandmarkClip {
                displacements: open.clone(),
                fps: 30.0,
            };
            clip.rest_in_silence(&prosody, &[strength; 90]);
            clip.displacements
        };
        let calm = rested(0.0);
        assert_eq!(calm[[30, 66, 1]], 2e-3);
        assert!(calm[[89, 66, 1]].abs() < 1e-5, "{}", calm[[89, 66, 1]]);
        assert_eq!(calm[[89, 19, 1]], 2e-3);
        let steps = (1..90).map(|t| (calm[[t, 66, 1]] - calm[[t - 1, 66, 1]]).abs());
        assert!(steps.fold(0.0, f32::max) < 0.25e-3);
        assert_eq!(rested(1.0), open);
    }
}
