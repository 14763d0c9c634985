//! What an artist may change in a performance after it was sampled.

use std::ops::RangeInclusive;

use crate::{Error, Result};

/// Controls over a sampled performance; changing one needs no new sampling.
///
/// The default changes nothing but adds natural blinks and subtle raises of the brows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PerformanceControls {
    /// Scales what speech does to mouth and jaw, around the emotion's own expression: 0 to 2.
    pub articulation: f32,
    /// Who speaks: −1 halves the jaw's share and gives the lips half more, 1 the other way round.
    pub jaw_lips: f32,
    /// Deviation of a Gaussian over time, seconds, 0 to 0.1. Closed lips stay closed.
    pub smoothing_s: f32,
    /// Scales all motion of brows, lids and the bridge of the nose, except blinks: 0 to 2.
    pub upper_face: f32,
    /// How often both eyes blink, 0 to 60 times a minute.
    pub blinks_per_minute: f32,
    /// Strength of the raises of the brows on stressed syllables, 0 to 2.
    pub brow_accents: f32,
    /// −1 to 1: 1 makes brows and mouth corners move half more on the subject's left and half less
    /// on the right, −1 the other way round.
    pub asymmetry: f32,
}

impl Default for PerformanceControls {
    fn default() -> Self {
        PerformanceControls {
            blinks_per_minute: 15.0,
            brow_accents: 1.0,
            ..Self::as_sampled()
        }
    }
}

impl PerformanceControls {
    /// The motion as the model made it, nothing added: for evaluation.
    pub fn as_sampled() -> Self {
        PerformanceControls {
            articulation: 1.0,
            jaw_lips: 0.0,
            smoothing_s: 0.0,
            upper_face: 1.0,
            blinks_per_minute: 0.0,
            brow_accents: 0.0,
            asymmetry: 0.0,
        }
    }

    /// Whether every number is in its range.
    ///
    /// # Errors
    /// `InvalidInput` names the first that is not, its range and what it is.
    pub fn check(&self) -> Result<()> {
        let ranges: [(&str, f32, RangeInclusive<f32>); 7] = [
            ("articulation", self.articulation, 0.0..=2.0),
            ("jaw_lips", self.jaw_lips, -1.0..=1.0),
            ("smoothing_s", self.smoothing_s, 0.0..=0.1),
            ("upper_face", self.upper_face, 0.0..=2.0),
            ("blinks_per_minute", self.blinks_per_minute, 0.0..=60.0),
            ("brow_accents", self.brow_accents, 0.0..=2.0),
            ("asymmetry", self.asymmetry, -1.0..=1.0),
        ];
        for (name, value, range) in ranges {
            if !range.contains(&value) {
                let (low, high) = (range.start(), range.end());
                return Err(Error::InvalidInput(format!(
                    "{name}: expected {low} to {high}, got {value}"
                )));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        let wrong = PerformanceControls {
            smoothing_s: 0.2,
            ..Default::default()
        };
        let message = wrong.check().unwrap_err().to_string();
        assert_eq!(message, "smoothing_s: expected 0 to 0.1, got 0.2");
        let nan = PerformanceControls {
            asymmetry: f32::NAN,
            ..Default::default()
        };
        assert!(nan.check().unwrap_err().to_string().contains("asymmetry"));
    }

    #[test]
    fn both_presets_are_in_range() {
        PerformanceControls::default().check().unwrap();
        PerformanceControls::as_sampled().check().unwrap();
    }
}
