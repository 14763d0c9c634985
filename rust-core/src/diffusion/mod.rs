//! Diffusion sampling that knows no network.
//!
//! [`Ddim`] takes a function from noisy sample and step to a prediction of the clean sample and
//! walks from noise to a sample. Guidance and the like wrap that function.

mod ddim;
mod noise;
mod schedule;

pub use ddim::{Ddim, Spacing};
pub use noise::frame_noise;
pub use schedule::Schedule;
