//! When the lips touch and which shapes the mouth takes, judged by the phones.

use super::{LipClosures, LipShapes, SpeechFeatures};

/// Smallest probability whose log-odds count.
const LEAST: f32 = 1e-5;
/// Log-odds at which the lips close fully, and at which the lower lip reaches the teeth, beyond the odds
/// that [`LipClosures`] asks for. In 120 clips of GRID, which the read-out of phones has not learned, 98 %
/// of the closures and about 80 % of the touches of the teeth are then at such a phone.
const TOGETHER: f32 = 1.0;
const AT_TEETH: f32 = 1.7;

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

impl SpeechFeatures {
    /// When the lips touch. `intervals`: `[start_s, end_s]` of closed lips, which replace those of
    /// the sound. Without phones ([`SpeechFeatures::phone_rows`]) only these close the lips.
    pub fn contacts(&self, intervals: Option<&[[f64; 2]]>) -> LipContacts {
        let rate_hz = self.track.rate_hz;
        let heard = self.phone_rows();
        let heard = heard.map(|(phones, rows)| phones.contacts(rows, rate_hz));
        let (together, at_teeth, shapes): (Vec<f32>, Vec<f32>, _) = match heard {
            Some(heard) => {
                let all =
                    |heard: Vec<f32>, odds| heard.into_iter().map(|p| sure(p, odds)).collect();
                (
                    all(heard.together, TOGETHER),
                    all(heard.at_teeth, AT_TEETH),
                    heard.shapes,
                )
            }
            None => (Vec::new(), Vec::new(), LipShapes::none()),
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

/// The probability of a contact by the phones alone, on the scale of [`LipClosures`].
fn sure(phones: f32, odds: f32) -> f32 {
    let p = phones.clamp(LEAST, 1.0 - LEAST);
    1.0 / (1.0 + (1.0 - p) / p * odds.exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_is_full_where_its_phones_are_likely() {
        assert!((0.33..0.37).contains(&sure(0.6, TOGETHER)) && sure(0.5, TOGETHER) < 0.3);
        assert!((0.33..0.37).contains(&sure(0.75, AT_TEETH)) && sure(0.5, AT_TEETH) < 0.2);
        assert!(sure(0.0, TOGETHER) < 1e-4 && sure(1.0, AT_TEETH) > 0.99);
    }
}
