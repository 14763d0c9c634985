//! FreeTalk (Nocentini et al. 2026): Audio-To-Sparse, then Sparse-To-Mesh.

pub mod ats;
mod sampling;
pub mod stm;
pub mod stream;

pub use sampling::{AtsRequest, windows};
