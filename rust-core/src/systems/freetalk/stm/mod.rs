//! Sparse-To-Mesh: FreeTalk's own decoder, run for every frame. The weights that are fixed for a mesh,
//! which are the default, serve every system that gives landmarks: [`crate::deform::static_weights`].

mod landmark_graph;
pub mod paper;
mod paper_face;
mod shares;

pub use paper_face::{PaperFace, prepare_paper};
