//! FaceTalk (Aneja et al. 2023): speech to expression codes of a head that is a field.

mod config;
mod denoiser;
mod opening;
mod system;

pub use config::{MotionConfig, MotionConfigs, Sampling};
pub use denoiser::{Denoiser, Memory};
pub use system::{FaceTalk, REGISTRATION};
