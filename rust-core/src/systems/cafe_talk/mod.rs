//! Cafe-Talk (Chen et al. 2025): speech to ARKit weights under coarse and fine control.

mod calibration;
mod config;
mod denoiser;
mod priority;
mod sampling;
mod system;
mod window_cache;

use config::CafeTalkConfig;
use denoiser::Denoiser;
use sampling::{Guidance, Request};
pub use system::REGISTRATION;
