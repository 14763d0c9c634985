//! Sparse-To-Mesh: FreeTalk's own decoder, which runs on every frame. It is not the default: the
//! default weights are fixed for a mesh and serve every system that outputs landmarks
//! ([`crate::deform::static_weights`]).

mod landmark_graph;
pub mod paper;
mod paper_face;
mod shares;

pub use paper_face::prepare_paper;
