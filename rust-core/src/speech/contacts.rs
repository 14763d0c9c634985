//! When lips touch, as the encoder and the phones hear it together.

use super::{Heard, LipClosures, PhoneModel, heard::heard_or_given};

/// Weight of the phones' log-odds beside the encoder's own, and what is added so that both together raise no more
/// false closures than the encoder alone.
const PHONES_SHARE: f32 = 0.45;
const EARLIER: f32 = 1.5;
const LEAST: f32 = 1e-5;

impl Heard {
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
