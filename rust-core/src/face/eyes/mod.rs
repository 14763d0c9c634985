//! How far the eyes of a face are open, and the balls that their lids slide over.
//!
//! Lengths are canonical centimetres.

mod ball;
mod balls;
mod joined;
mod mix;
mod opening;
mod openings;

pub(crate) use ball::Eyeball;
pub(crate) use mix::{Mix, ease};
use opening::Head;
pub use opening::Lids;
pub(crate) use opening::{EyeFrame, Opening, SAMPLES};
pub(crate) use openings::{LidDrive, Openings, SQUINT_M, UPPER_SHARE};
