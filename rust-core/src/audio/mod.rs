//! Sound in any common format becomes mono 16 kHz samples.
//!
//! Decoding, mixing and resampling run chunk by chunk, so an hour of stereo at 192 kHz needs no
//! more memory than its 16 kHz result (230 MB an hour).

mod compressed;
mod edit_list;
mod file;
mod intake;
mod pitch;
mod prosody;
mod resample;
mod source;
mod wav;

use std::path::Path;

use crate::{Error, Result, outside::guarded};
use intake::Intake;

pub use file::{LARGEST_LOSS, SoundDamage, SoundFile};
pub use prosody::{PROSODY_FPS, Prosody};

/// Sample rate of every [`Waveform`].
pub const SAMPLE_RATE_HZ: u32 = 16_000;

/// Sample rates that are accepted, in Hz.
pub const ACCEPTED_RATES_HZ: std::ops::RangeInclusive<u32> = 4_000..=384_000;

/// Magnitude beyond which a sample is no sound: 80 dB over full scale.
pub const LOUDEST: f32 = 1e4;

/// Peak below which a sound counts as silence: −60 dB of full scale.
pub const SILENCE_PEAK: f32 = 1e-3;

/// Mono sound at [`SAMPLE_RATE_HZ`].
///
/// ```
/// use anyface::audio::Waveform;
///
/// let stereo = [0.5f32; 2 * 48_000];
/// let sound = Waveform::from_interleaved(&stereo, 2, 48_000)?;
/// assert_eq!((sound.samples.len(), sound.duration_s()), (16_000, 1.0));
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Waveform {
    /// `[S]`, nominally in [−1, 1], always finite.
    pub samples: Vec<f32>,
}

impl Waveform {
    /// Decodes a file: WAV, MP3, FLAC, Ogg Vorbis, M4A (AAC or ALAC) or AIFF.
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

    /// From a host's own samples.
    ///
    /// `samples`: `[S, C]` interleaved, nominally in [−1, 1]; `rate_hz` within
    /// [`ACCEPTED_RATES_HZ`]. The result has `round(S · 16000 / rate_hz)` samples, at least one.
    ///
    /// # Errors
    /// `Audio` for no samples, a length that is no multiple of `channels`, a rate out of range,
    /// or samples that are not finite or beyond ±[`LOUDEST`] (says how many and where the first is).
    pub fn from_interleaved(samples: &[f32], channels: usize, rate_hz: u32) -> Result<Self> {
        if channels == 0 || !samples.len().is_multiple_of(channels) {
            return Err(Error::Audio(format!(
                "expected whole frames of {channels} channels, got {} samples",
                samples.len()
            )));
        }
        guarded(Error::Audio, || {
            let mut intake = Intake::new(channels, rate_hz)?;
            intake.push(samples)?;
            intake.finish()
        })
    }

    /// Length in seconds.
    pub fn duration_s(&self) -> f64 {
        self.samples.len() as f64 / f64::from(SAMPLE_RATE_HZ)
    }

    /// Largest magnitude of any sample.
    pub fn peak(&self) -> f32 {
        self.samples.iter().fold(0.0, |peak, x| peak.max(x.abs()))
    }

    /// Whether nothing rises above [`SILENCE_PEAK`].
    pub fn is_silent(&self) -> bool {
        self.peak() < SILENCE_PEAK
    }
}

#[cfg(test)]
mod tests;
