//! FaceTalk (Aneja et al. 2023): speech to expression codes of a head that is a field.

mod config;
mod denoiser;

pub use config::{MotionConfig, Sampling};
pub use denoiser::{Denoiser, Memory};
