//! Sound in any common format becomes mono 16 kHz samples.
//!
//! Decoding, mixing and resampling run chunk by chunk. Of a sound longer than ten minutes, only the
//! requested stretch is in memory.

mod compressed;
mod damage;
mod edit_list;
mod file;
mod intake;
mod long_wav;
mod mixdown;
mod opus;
mod pitch;
mod prosody;
mod resample;
mod source;
mod track;
mod wav;
mod waveform;

pub use damage::SoundDamage;
pub use file::{LARGEST_LOSS, SoundFile, WHOLE_S};
pub use pitch::PROSODY_FPS;
pub use prosody::Prosody;
pub use resample::RateConverter;
pub use track::AudioTrack;
pub use waveform::{ACCEPTED_RATES_HZ, LOUDEST, Levels, SAMPLE_RATE_HZ, SILENCE_PEAK, Waveform};

#[cfg(test)]
mod tests;
