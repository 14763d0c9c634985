//! How much of a sound is lost because its file is damaged.

/// Shorter losses are not reported: they are less than a syllable.
const UNHEARD_S: f64 = 0.05;
/// Losses below this share of the sound are not reported either.
const UNHEARD_SHARE: f64 = 0.01;

/// How much of the sound is missing in a damaged file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoundDamage {
    /// Seconds that could not be read.
    pub missing_s: f64,
    /// Seconds that the file should hold.
    pub expected_s: f64,
}

impl SoundDamage {
    /// The loss, if it is large enough to be heard.
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

    /// The loss as a sentence for the user.
    pub fn sentence(&self) -> String {
        format!(
            "the sound file is damaged: {:.2} s of {:.2} s are missing, and what follows may come too early",
            self.missing_s, self.expected_s
        )
    }
}
