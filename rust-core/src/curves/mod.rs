//! Weights over time as few Bézier keys, which an animator can edit.
//!
//! A [`Curve`] passes through the values at its keys. Between two of them it is a Bézier segment as
//! animation tools evaluate it, whose handles reach [`REACH`] of the way to the next key. The fewest
//! keys that stay within a tolerance are found by dynamic programming (Schneider 1990 splits where
//! it must; this looks at all ways to split), extremes first. What counts is the face, not the
//! curve: [`on_face`] measures the sum of all curves on the vertices.

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
