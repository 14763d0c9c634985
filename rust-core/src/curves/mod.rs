//! Turns weights over time into a few Bézier keys, which an animator can edit.
//!
//! A [`Curve`] passes through the values at its keys. Between two keys it is a Bézier segment,
//! evaluated as in animation tools. Its handles reach [`REACH`] of the way to the next key. Dynamic
//! programming finds the fewest keys that stay within a tolerance and prefers keys at extremes.
//! (Schneider 1990 splits a segment only where it must; this search tries all ways to split.) The
//! face matters, not the single curve: [`on_face`] measures the sum of all curves on the vertices.

mod face;
mod fit;
mod search;
mod segment;
mod slopes;
#[cfg(test)]
mod tests;

pub use face::{FaceFit, on_face};
pub use fit::{evaluate, fit, fit_each};
pub use segment::REACH;
pub use slopes::{Curve, Key};
