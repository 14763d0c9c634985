//! Spreads landmark motion over a whole mesh.
//!
//! Every decoder implements [`Deformer`](crate::face::Deformer). The default one is
//! [`LandmarkWeights`]: fixed weights over the landmarks, shared by systems. On the skin they come
//! from [`PlateWeights`], and everything else follows the skin, the jaw or the skull
//! ([`binding`](crate::face::binding)). [`StaticWeights`] adds a learned part, and [`Creases`] adds
//! the detail that another face shows between the landmarks. [`Corrected`] adds everything that is
//! not linear: the jaw's rotation, lips that touch, lids that slide over their eyeballs.
//! [`compression`] turns the result into a few basis shapes, [`long_compression`] does so for clips
//! that do not fit into memory, and [`projection`] fits these shapes to other motion.

pub mod compression;
mod contact;
mod corrected;
mod correspondence;
pub mod creases;
mod decoder;
mod eyelids;
pub(crate) mod fade;
pub mod jaw;
mod joined_lips;
mod landmark_weights;
pub mod long_compression;
mod prepare;
pub mod projection;
mod row_weights;
pub mod static_weights;
mod tension_screened_biharmonic;
mod untangle;

pub use corrected::{Corrected, Corrections};
pub use correspondence::{Correspondence, FollowingFace, ReferencePoints};
pub use creases::{Creases, ReferenceFace};
pub use decoder::{CodeSpace, Decoder};
pub use landmark_weights::LandmarkWeights;
pub use prepare::{LEARNED, SolvedSkin, static_deformer};
pub use static_weights::{StaticWeights, VertexGeometry};
pub use tension_screened_biharmonic::{Plate, PlateWeights, REACHES_CM};

use ndarray::Array3;

/// Displacements of every vertex over time.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexClip {
    /// `[T, V, 3]`, in the mesh's own units, axes and vertex order.
    pub displacements: Array3<f32>,
    /// Frames per second.
    pub fps: f64,
}
