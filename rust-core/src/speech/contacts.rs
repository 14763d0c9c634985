//! When the lips touch and which shapes the mouth takes, judged by the phones.

use super::{Heard, LipClosures, LipShapes};

/// Smallest probability whose log-odds count.
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
    /// the sound. Without phones ([`Heard::phone_rows`]) only these close the lips.
    pub fn contacts(&self, intervals: Option<&[[f64; 2]]>) -> LipContacts {
        let rate_hz = self.track.rate_hz;
        let heard = self.phone_rows();
        let heard = heard.map(|(phones, rows)| phones.contacts(rows, rate_hz));
        let (together, at_teeth, shapes) = match heard {
            Some(heard) => {
                let together: Vec<f32> = heard.together.into_iter().map(sure).collect();
                (together, heard.at_teeth, heard.shapes)
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

/// The probability of a closure by the phones alone, on the scale of [`LipClosures`]: with [`EVEN`]
/// log-odds the lips close fully where the phones are even.
fn sure(phones: f32) -> f32 {
    let p = phones.clamp(LEAST, 1.0 - LEAST);
    1.0 / (1.0 + (1.0 - p) / p * EVEN.exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lips_close_fully_where_phones_are_even() {
        assert!((sure(0.5) - 0.35).abs() < 1e-2);
        assert!(sure(0.0) < 1e-4 && sure(1.0) > 0.99);
    }
}
