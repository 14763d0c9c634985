//! When lips touch, as the encoder and the phones hear it together.

use super::{Heard, LipClosures};

/// Weight of the phones' log-odds beside the encoder's own, and what is added so that both together raise no more
/// false closures than the encoder alone.
const PHONES_SHARE: f32 = 0.45;
const EARLIER: f32 = 1.5;
const LEAST: f32 = 1e-5;

/// When the lips of a speaker touch.
#[derive(Debug, Clone, PartialEq)]
pub struct LipContacts {
    /// One another, for p, b, m.
    pub together: LipClosures,
    /// The lower lip the upper teeth, for f, v.
    pub at_teeth: LipClosures,
}

impl Heard {
    /// When the lips touch: as the sound says, or together in the `given` intervals `[start_s, end_s]`.
    ///
    /// Two witnesses hear p, b, m: the encoder ([`super::SpeechEncoder::closed_lips`]) and the phones. They miss
    /// fewer than the encoder alone at as many false ones (the card of `cafe_talk_compact` counts them). The phones
    /// alone hear f and v. Without phones that know the encoder's features the encoder is the one witness.
    pub fn contacts(&self, given: Option<&[[f64; 2]]>) -> LipContacts {
        let rate_hz = self.track.rate_hz;
        let features = self.features(rate_hz);
        let closed = self
            .encoder
            .closed_lips(features.view())
            .unwrap_or_default();
        let phones = self
            .phones
            .as_ref()
            .filter(|phones| phones.hears(&self.track, self.encoder_name()));
        let (together, at_teeth) = match phones.map(|phones| phones.contacts(features.view())) {
            Some(heard) => {
                let both = closed.iter().zip(&heard.together);
                (both.map(|(a, b)| agreed(*a, *b)).collect(), heard.at_teeth)
            }
            None => (closed, Vec::new()),
        };
        let together = LipClosures::heard(&together, rate_hz);
        LipContacts {
            together: match given {
                Some(given) => together.mended(given),
                None => together,
            },
            at_teeth: LipClosures::heard(&at_teeth, rate_hz),
        }
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
