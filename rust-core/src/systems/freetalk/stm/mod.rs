//! Sparse-To-Mesh: 68 moving landmarks to every vertex.
//!
//! `static`, the default, makes fixed weights for a mesh once ([`prepare_static`]); a frame then
//! costs one small matrix product. `paper` is FreeTalk's own decoder, run for every frame.

pub mod paper;
mod paper_face;
mod prepare;
mod row_weights;
mod static_weights;

pub use paper_face::PaperFace;
pub use prepare::{prepare_paper, prepare_static};
pub use static_weights::{Correction, MIRROR, StaticConfig, StaticWeights, VertexGeometry};
