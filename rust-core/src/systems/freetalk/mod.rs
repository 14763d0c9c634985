//! FreeTalk (Nocentini et al. 2026): Audio-To-Sparse, then Sparse-To-Mesh.

pub mod ats;
mod sampling;
pub mod stm;
pub mod stream;
mod system;

pub use sampling::AtsRequest;
pub use system::{ATS_MODEL, FreeTalk, REGISTRATION, STREAM_MODEL};
