//! Everything that is heard in one sound.

use std::sync::Arc;

use ndarray::Array2;

use super::{FeatureTrack, FeltVoice, PhoneModel, SpeechEncoder, at_motion_frames};
use crate::{
    Result,
    audio::{Prosody, Waveform},
    conditions::EmotionCurve,
    motion::LipClosures,
};

/// Weight of the phones' log-odds beside the encoder's own, and what is added so that both together raise no more
/// false closures than the encoder alone.
const PHONES_SHARE: f32 = 0.45;
const EARLIER: f32 = 1.5;
const LEAST: f32 = 1e-5;

/// A sound as systems hear it: speech features, how it was said, and how long it is.
///
/// ```
/// use std::sync::Arc;
/// use anyface::{audio::Waveform, speech::{self, Heard, SpeechEncoder}};
///
/// let encoder: Arc<dyn SpeechEncoder> = Arc::new(speech::compact(None)?);
/// let sound = Waveform { samples: (0..16_000).map(|i| (i as f32 * 0.08).sin()).collect() };
/// let heard = Heard::of(&sound, &encoder)?;
/// assert_eq!(heard.features(30.0).dim(), (heard.frames(30.0), encoder.channels()));
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Clone)]
pub struct Heard {
    /// Speech features at the encoder's own rate.
    pub track: FeatureTrack,
    /// Loudness, pitch, effort, syllables and pauses.
    pub prosody: Prosody,
    /// The voice as an encoder of feelings takes it.
    pub voice: FeltVoice,
    /// What another's model of emotions hears in it, where the engine has one.
    pub emotion: Option<EmotionCurve>,
    /// Length of the sound in seconds.
    pub duration_s: f64,
    encoder: Arc<dyn SpeechEncoder>,
}

impl Heard {
    /// Listens to a sound.
    ///
    /// # Errors
    /// Those of [`SpeechEncoder::encode`].
    pub fn of(waveform: &Waveform, encoder: &Arc<dyn SpeechEncoder>) -> Result<Heard> {
        Ok(Heard {
            track: encoder.encode(waveform)?,
            prosody: Prosody::of(waveform),
            voice: FeltVoice::of(waveform),
            emotion: None,
            duration_s: waveform.duration_s(),
            encoder: Arc::clone(encoder),
        })
    }

    /// The name of the encoder that heard it.
    pub fn encoder_name(&self) -> &'static str {
        self.encoder.name()
    }

    /// One frame for every started `1 / fps` seconds, at least one.
    pub fn frames(&self, fps: f64) -> usize {
        frames_of(self.duration_s, fps)
    }

    /// Speech features at the times of motion frames, `[T, C]`.
    pub fn features(&self, fps: f64) -> Array2<f32> {
        at_motion_frames(&self.track, self.frames(fps), fps)
    }

    /// When lips are together: as the encoder hears it ([`SpeechEncoder::closed_lips`]), or in the
    /// `given` intervals `[start_s, end_s]`.
    pub fn closures(&self, given: Option<&[[f64; 2]]>) -> LipClosures {
        let rate_hz = self.track.rate_hz;
        let closed = self.encoder.closed_lips(self.features(rate_hz).view());
        heard_or_given(&closed.unwrap_or_default(), rate_hz, given)
    }

    /// The same by two witnesses, the encoder's own read-out and the phones' p, b and m, which miss fewer than the
    /// encoder alone at as many false ones (the card of `cafe_talk_compact` counts them); and when the lower lip is at
    /// the upper teeth, as the phones' f and v have it.
    ///
    /// The encoder alone, and never at the teeth, where the phones were not made for it.
    pub fn contacts_with(
        &self,
        phones: &PhoneModel,
        given: Option<&[[f64; 2]]>,
    ) -> (LipClosures, LipClosures) {
        let rate_hz = self.track.rate_hz;
        if !phones.hears(self) {
            return (self.closures(given), LipClosures::heard(&[], rate_hz));
        }
        let features = self.features(rate_hz);
        let heard = phones.contacts(features.view());
        let together = match self.encoder.closed_lips(features.view()) {
            Some(closed) => {
                let both = closed.iter().zip(&heard.together);
                both.map(|(a, b)| agreed(*a, *b)).collect()
            }
            None => Vec::new(),
        };
        (
            heard_or_given(&together, rate_hz, given),
            LipClosures::heard(&heard.at_teeth, rate_hz),
        )
    }
}

/// What two witnesses of a closure say together: their log-odds, weighed.
fn agreed(encoder: f32, phones: f32) -> f32 {
    let odds = |p: f32| {
        let p = p.clamp(LEAST, 1.0 - LEAST);
        (p / (1.0 - p)).ln()
    };
    let sum = (1.0 - PHONES_SHARE) * odds(encoder) + PHONES_SHARE * odds(phones) + EARLIER;
    1.0 / (1.0 + (-sum).exp())
}

fn heard_or_given(closed: &[f32], rate_hz: f64, given: Option<&[[f64; 2]]>) -> LipClosures {
    let heard = LipClosures::heard(closed, rate_hz);
    match given {
        Some(given) => heard.mended(given),
        None => heard,
    }
}

/// One frame for every started `1 / fps` seconds of a sound, at least one.
pub fn frames_of(duration_s: f64, fps: f64) -> usize {
    // A millionth of a frame is rounding, not sound.
    (duration_s * fps - 1e-6).ceil().max(1.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_witnesses_hear_what_one_is_not_sure_of() {
        assert!(agreed(0.1, 0.2) > 0.33 && agreed(0.3, 1e-4) < 0.2);
        assert!(agreed(0.99, 0.9) > 0.98 && agreed(0.0, 0.0) < 1e-3);
        assert!(agreed(1.0, 1.0) <= 1.0);
        let rising: Vec<f32> = (1..10).map(|n| agreed(0.1 * n as f32, 0.3)).collect();
        assert!(rising.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
