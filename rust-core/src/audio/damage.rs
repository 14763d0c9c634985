//! What of a sound is lost where its file is damaged.

/// A loss below which nothing is said: less than a syllable, and less than this share.
const UNHEARD_S: f64 = 0.05;
const UNHEARD_SHARE: f64 = 0.01;

/// What a damaged file should have held and does not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoundDamage {
    /// Seconds that could not be read.
    pub missing_s: f64,
    /// Seconds that the file says it holds.
    pub expected_s: f64,
}

impl SoundDamage {
    /// The loss, where there is one that can be heard.
    pub(super) fn of(missing_s: f64, expected_s: f64) -> Option<SoundDamage> {
        let is_heard = missing_s > UNHEARD_S && missing_s > UNHEARD_SHARE * expected_s;
        is_heard.then_some(SoundDamage {
            missing_s,
            expected_s,
        })
    }

    /// Share of the sound that is missing, 0 to 1.
    pub fn share(&self) -> f64 {
        self.missing_s / self.expected_s
    }

    /// For people.
    pub fn sentence(&self) -> String {
        format!(
            "the sound file is damaged: {:.2} s of {:.2} s are missing, and what follows may come too early",
            self.missing_s, self.expected_s
        )
    }
}
