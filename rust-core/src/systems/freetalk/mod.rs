//! FreeTalk (Nocentini et al. 2026): Audio-To-Sparse, then Sparse-To-Mesh.

mod ats;
mod sampling;
mod stm;
mod stream;
mod system;

use sampling::AtsRequest;
pub use system::REGISTRATION;
