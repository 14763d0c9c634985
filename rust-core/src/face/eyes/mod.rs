//! How far the eyes of a face are open, and the balls that their lids slide over.
//!
//! Lengths are canonical centimetres.

mod ball;
mod joined;
mod mix;
mod opening;
mod openings;

pub(crate) use ball::Eyeball;
pub(crate) use mix::{Mix, ease};
pub use opening::Lids;
pub(crate) use opening::{EyeFrame, Head, Opening, SAMPLES};
pub(crate) use openings::{Openings, UPPER_SHARE};
