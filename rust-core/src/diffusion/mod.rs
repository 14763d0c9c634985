//! Diffusion sampling that knows no network.
//!
//! [`Ddim`] takes a function from noisy sample and step to a prediction of the clean sample and
//! walks from noise to a sample. Guidance wraps that function.

mod ddim;
mod guidance;
mod noise;
mod schedule;

pub use ddim::{Ddim, Spacing};
pub use guidance::{guided, mask_guided};
pub use noise::{frame_noise, slow_noise};
pub use schedule::Schedule;

use serde::{Deserialize, Serialize};

/// The forward process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Diffusion {
    /// Noise schedule.
    pub schedule: Schedule,
    /// Number of diffusion steps in training.
    pub train_steps: usize,
}
