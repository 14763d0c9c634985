//! A sound from a file.

use std::path::Path;

use super::{Waveform, compressed, damage::SoundFile, long_wav, source::Source, wav};
use crate::{Error, Result, job::outside::guarded};

/// Share of a sound whose loss makes the rest useless, unless the caller knows.
pub const LARGEST_LOSS: f64 = 0.2;

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
        let file = guarded(Error::Audio, || {
            let source = long_wav::as_wav(source)?;
            match wav::decode(path, &source)? {
                wav::Decoded::Sound(file) => Ok(file),
                wav::Decoded::NotForUs => compressed::decode(path, &source),
            }
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

impl Waveform {
    /// Decodes a file: WAV (RF64 and Wave64 too), MP3, FLAC, Ogg or WebM (Vorbis or Opus), M4A (AAC or ALAC), AAC,
    /// CAF or AIFF.
    ///
    /// Channels are averaged, never summed, so nothing clips; samples outside [−1, 1] are kept.
    ///
    /// # Errors
    /// `Io` if the file cannot be read; `Audio` if it cannot be decoded, holds no sample, holds samples
    /// that are not finite or beyond ±[`LOUDEST`], or is damaged so that more than a fifth is missing
    /// ([`SoundFile::read`] tells how much).
    pub fn from_file(path: &Path) -> Result<Self> {
        SoundFile::read(path, false).map(|file| file.waveform)
    }
}
