//! How a speaker sounds while he feels nothing, so that a low or rough voice is taken for no emotion.

use ndarray::Array1;

use super::{EVERY, EmotionEar, Instant};
use crate::{Error, Result, speech::VoiceTrack};

/// Windows with a voice of which a speaker's own voice is believed by half.
///
/// The mean of few windows says what was said rather than who said it.
const HALF_BELIEVED: f64 = 12.0;

/// A speaker's neutral voice, as an ear hears it.
#[derive(Debug, Clone, PartialEq)]
pub struct NeutralVoice {
    /// What every row of the speaker gets added, `[told + 118]`.
    pub(super) offset: Array1<f64>,
}

impl EmotionEar {
    /// How a speaker sounds in a recording in which he feels nothing.
    ///
    /// Rows of his voice are moved by the way from his mean row there to that of the readers who were taught. A mean over
    /// little of a voice moves them less.
    ///
    /// # Errors
    /// `Audio` if nobody speaks in it.
    pub fn neutral_voice(&self, voice: &VoiceTrack) -> Result<NeutralVoice> {
        let windows = voice.windows(EVERY);
        let loudest = windows.iter().map(|window| window.loud);
        let loudest = loudest.fold(f64::NEG_INFINITY, f64::max);
        let (mut sum, mut total) = (Array1::zeros(self.readers.len()), 0.0);
        for window in &windows {
            let weight = Instant::of(window, Array1::zeros(0)).weight(loudest);
            if weight > 0.0 {
                sum.scaled_add(weight, &self.row(window));
                total += weight;
            }
        }
        if total == 0.0 {
            return Err(Error::Audio(
                "neutral voice: expected somebody who speaks, got a recording without a voice"
                    .into(),
            ));
        }
        let share = total / (total + HALF_BELIEVED);
        Ok(NeutralVoice {
            offset: (&self.readers - sum / total) * share,
        })
    }
}
