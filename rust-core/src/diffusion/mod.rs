//! Diffusion sampling that does not depend on any network.
//!
//! [`Ddim`] walks from noise to a sample. It takes a function that predicts the clean sample from a
//! noisy sample and a step. Guidance wraps that function.

mod ddim;
mod guidance;
mod noise;
mod schedule;

pub(crate) use ddim::{Ddim, Spacing};
#[cfg(any(feature = "cafe-talk", feature = "facetalk"))]
pub(crate) use guidance::guided;
#[cfg(feature = "cafe-talk")]
pub(crate) use guidance::mask_guided;
pub use noise::frame_noise;
pub(crate) use noise::slow_noise;
pub(crate) use schedule::Schedule;

use serde::{Deserialize, Serialize};

/// The forward process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Diffusion {
    /// Noise schedule.
    pub schedule: Schedule,
    /// Number of diffusion steps in training.
    pub train_steps: usize,
}
