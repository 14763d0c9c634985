//! A sound from a file, and what of it is lost where the file is damaged.

use std::path::Path;

use super::{Waveform, compressed, source::Source, wav};
use crate::{Error, Result, outside::guarded};

/// A loss below which nothing is said: less than a syllable, and less than this share.
const UNHEARD_S: f64 = 0.05;
const UNHEARD_SHARE: f64 = 0.01;
/// Share of a sound whose loss makes the rest useless, unless the caller knows.
pub const LARGEST_LOSS: f64 = 0.2;

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

/// A sound, and what is lost of it.
#[derive(Debug, Clone, PartialEq)]
pub struct SoundFile {
    /// What could be read.
    pub waveform: Waveform,
    /// What could not.
    pub damage: Option<SoundDamage>,
}

impl SoundFile {
    /// Decodes a file, as [`Waveform::from_file`] does, and tells what is missing: samples that a header
    /// promises, packets that do not decode, gaps between pages.
    ///
    /// `any_damage`: whether a sound of which more than a fifth is missing is wanted all the same.
    ///
    /// # Errors
    /// Those of [`Waveform::from_file`].
    pub fn read(path: &Path, any_damage: bool) -> Result<SoundFile> {
        let source = Source::open(path)?;
        let file = guarded(Error::Audio, || match wav::decode(path, &source)? {
            wav::Decoded::Sound(file) => Ok(file),
            wav::Decoded::NotForUs => compressed::decode(path, &source),
        });
        let file = file.map_err(|error| named(path, error))?;
        match file.damage {
            Some(damage) if damage.share() > LARGEST_LOSS && !any_damage => {
                Err(Error::Audio(format!(
                    "{}: expected at least {:.0} % of the sound, got a file of which {:.2} s of {:.2} s are \
                     missing",
                    path.display(),
                    100.0 * (1.0 - LARGEST_LOSS),
                    damage.missing_s,
                    damage.expected_s
                )))
            }
            _ => Ok(file),
        }
    }
}

/// Errors of samples and decoders do not know the file's name.
fn named(path: &Path, error: Error) -> Error {
    let shown = path.display().to_string();
    match error {
        Error::Audio(message) if !message.contains(&shown) => {
            Error::Audio(format!("{shown}: {message}"))
        }
        other => other,
    }
}
