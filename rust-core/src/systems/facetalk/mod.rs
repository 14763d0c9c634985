//! FaceTalk (Aneja et al. 2023): speech to expression codes of a head that is a field.

mod config;
mod denoiser;
mod opening;
mod system;

use config::{MotionConfig, MotionConfigs, Sampling};
use denoiser::Denoiser;
pub use system::REGISTRATION;
