//! Brings the mouth to rest where nobody speaks.

use super::{LandmarkClip, phrases::smooth_step};
use crate::{
    audio::{PROSODY_FPS, Prosody},
    mesh::ibug::speaking,
};

/// For this long before and after speech the mouth moves as the network says, seconds.
const NEAR_S: f64 = 0.2;
/// How long it then takes to come to rest, seconds.
const SETTLE_S: f64 = 0.5;
/// A sound without pauses is silent if its loud frames lie below this level, dB.
const SILENT_DB: f32 = -80.0;

impl LandmarkClip {
    /// Brings jaw and lips to rest in pauses. `strength` `[T]` is that of the emotion, which stays
    /// on them: at 1 nothing changes. Pauses of up to half a second between speech hardly change.
    pub(crate) fn rest_in_silence(&mut self, prosody: &Prosody, strength: &[f32]) {
        let mut frames = self.displacements.outer_iter_mut();
        for (t, strength) in strength.iter().enumerate() {
            let Some(mut frame) = frames.next() else {
                return;
            };
            let away_s = away_s(prosody, t as f64 / self.fps) - NEAR_S;
            let rest = smooth_step(away_s / SETTLE_S) as f32 * (1.0 - strength.clamp(0.0, 1.0));
            if rest > 0.0 {
                speaking().for_each(|n| frame.row_mut(n).map_inplace(|x| *x *= 1.0 - rest));
            }
        }
    }
}

/// Time from the nearest speech, seconds: 0 within speech, voiced or whispered, and infinite in a
/// silent sound.
fn away_s(prosody: &Prosody, time_s: f64) -> f64 {
    if prosody.pauses.is_empty() && prosody.loud_db < SILENT_DB {
        return f64::INFINITY;
    }
    let frame = time_s * PROSODY_FPS;
    let over = |pause: &&std::ops::Range<usize>| (pause.end as f64) <= frame;
    let next = prosody.pauses.iter().find(|pause| !over(pause));
    let Some(pause) = next.filter(|pause| pause.start as f64 <= frame) else {
        return 0.0;
    };
    // Nobody speaks before the first frame and after the last.
    let before = if pause.start == 0 {
        f64::INFINITY
    } else {
        frame - pause.start as f64
    };
    let is_last = pause.end == prosody.level_db.len();
    let after = if is_last {
        f64::INFINITY
    } else {
        pause.end as f64 - frame
    };
    before.min(after) / PROSODY_FPS
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

    #[test]
    fn a_whisper_without_a_voiced_syllable_is_speech() {
        let mut prosody = voice(3, 100);
        prosody.nuclei.clear();
        let open = Array3::from_elem((90, 68, 3), 2e-3);
        let mut clip = LandmarkClip {
            displacements: open.clone(),
            fps: 30.0,
        };
        clip.rest_in_silence(&prosody, &[0.0; 90]);
        let spoken = ndarray::s![..60, .., ..];
        assert_eq!(clip.displacements.slice(spoken), open.slice(spoken));

        // A mouth without any sound rests.
        prosody.pauses.clear();
        clip.rest_in_silence(&prosody, &[0.0; 90]);
        assert_eq!(clip.displacements[[10, 66, 1]], 0.0);
    }
}
