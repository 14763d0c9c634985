//! Sound in any common format becomes mono 16 kHz samples.
//!
//! Decoding, mixing and resampling run chunk by chunk, so an hour of stereo at 192 kHz needs no
//! more memory than its 16 kHz result (230 MB an hour).

mod compressed;
mod damage;
mod edit_list;
mod file;
mod intake;
mod long_wav;
mod opus;
mod pitch;
mod prosody;
mod resample;
mod source;
mod wav;
mod waveform;

pub use damage::{SoundDamage, SoundFile};
pub use file::LARGEST_LOSS;
pub use pitch::PROSODY_FPS;
pub use prosody::Prosody;
pub use waveform::{ACCEPTED_RATES_HZ, LOUDEST, SAMPLE_RATE_HZ, SILENCE_PEAK, Waveform};

#[cfg(test)]
mod tests;
