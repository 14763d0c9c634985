//! Sparse-To-Mesh: 68 moving landmarks to every vertex.
//!
//! `static`, the default, makes fixed weights for a mesh once ([`prepare_static`]); a frame then
//! costs one small matrix product. `paper` is FreeTalk's own decoder, run for every frame.

pub mod paper;
mod paper_face;
mod prepare;
mod static_weights;

pub use paper_face::PaperFace;
pub use prepare::{prepare_paper, prepare_static};
pub use static_weights::{Correction, MIRROR, StaticConfig, StaticWeights, VertexGeometry};

use crate::Result;

impl StaticWeights {
    /// The weights that the library carries.
    ///
    /// # Errors
    /// `Weights` if the library was built with a damaged file.
    pub fn embedded() -> Result<StaticWeights> {
        StaticWeights::load(
            include_bytes!("../../../../models/stm_static/model.safetensors"),
            include_str!("../../../../models/stm_static/config.json"),
        )
    }
}
