//! When the lips touch and which shapes the mouth takes, judged by the encoder and the phones.

use super::{Heard, LipClosures, LipShapes};

/// Weight of the phones' log-odds. The encoder's own get the rest.
const PHONES_SHARE: f32 = 0.45;
/// Bias of the joint log-odds: with it, both together raise no more false closures than the encoder
/// alone.
const EARLIER: f32 = 1.5;
const LEAST: f32 = 1e-5;
/// Log-odds that [`LipClosures`] takes for a full closure, less than even ones. Rows with even odds were
/// counted in training's evaluation; the card of `phones` has precision and recall.
const EVEN: f32 = 0.62;

/// When the lips of a speaker touch, and which shapes the mouth takes.
#[derive(Debug, Clone, PartialEq)]
pub struct LipContacts {
    /// The lips touch one another, for p, b, m.
    pub together: LipClosures,
    /// The lower lip touches the upper teeth, for f, v.
    pub at_teeth: LipClosures,
    /// How far the mouth goes to the shapes of other sounds.
    pub shapes: LipShapes,
}

impl Heard {
    /// When the lips touch. `intervals`: `[start_s, end_s]` of closed lips, which replace those of
    /// the sound.
    ///
    /// The phones find p, b, m, together with an encoder that has a read-out of its own for them
    /// ([`super::SpeechEncoder::closed_lips`]). Only the phones find f and v. If no phone model was
    /// trained on this encoder's features, the encoder decides alone.
    pub fn contacts(&self, intervals: Option<&[[f64; 2]]>) -> LipContacts {
        let rate_hz = self.track.rate_hz;
        let features = self.features(rate_hz);
        let closed = self.encoder.closed_lips(features.view());
        let phones = self
            .phones
            .as_ref()
            .filter(|phones| phones.hears(&self.track, self.encoder_name()));
        let (together, at_teeth, shapes) =
            match phones.map(|phones| phones.contacts(features.view(), rate_hz)) {
                Some(heard) => {
                    let together = match closed {
                        Some(closed) => {
                            let both = closed.iter().zip(&heard.together);
                            both.map(|(a, b)| agreed(*a, *b)).collect()
                        }
                        None => heard.together.into_iter().map(sure).collect(),
                    };
                    (together, heard.at_teeth, heard.shapes)
                }
                None => (closed.unwrap_or_default(), Vec::new(), LipShapes::none()),
            };
        let together = LipClosures::heard(&together, rate_hz);
        LipContacts {
            together: match intervals {
                Some(intervals) => together.mended(intervals),
                None => together,
            },
            at_teeth: LipClosures::heard(&at_teeth, rate_hz),
            shapes,
        }
    }
}

/// The probability of a closure by the phones alone, on the scale of [`LipClosures`]: with [`EVEN`]
/// log-odds the lips close fully where the phones are even.
fn sure(phones: f32) -> f32 {
    let p = phones.clamp(LEAST, 1.0 - LEAST);
    1.0 / (1.0 + (1.0 - p) / p * EVEN.exp())
}

/// The joint probability of a closure, from the weighted sum of both log-odds and a bias.
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
