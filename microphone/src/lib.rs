//! Sound from a microphone: mono at 16 kHz, whatever the device delivers.
//!
//! ```no_run
//! use std::time::Duration;
//! let mut microphone = anyface_microphone::Microphone::open(None)?;
//! let block = microphone.read(Duration::from_millis(20));
//! println!("{} samples of {}", block.samples.len(), microphone.name());
//! # Ok::<(), anyface_microphone::MicrophoneError>(())
//! ```

mod c;
mod capture;
mod devices;
mod intake;
mod monitor;

pub use capture::{Block, Microphone};
pub use devices::{MicrophoneError, devices};
pub use monitor::Monitor;

/// Samples per second of all sound that a microphone or a monitor exchanges with its caller.
pub const SAMPLE_RATE_HZ: u32 = 16_000;
