//! A face whose mouth or eyes were cut open, and what each of its pieces was before.

mod refine;
mod source;

use super::{Face, FaceOptions};
use crate::mesh::{LandmarkSource, Landmarks, Mesh};
pub(super) use refine::{FineMesh, mixed};
pub use source::TriangleSource;

/// A mesh whose lips or lids were one surface and can part now.
#[derive(Debug, Clone, PartialEq)]
pub struct OpenedFace {
    /// The old vertices with their numbers, where they were; then the new ones. The old triangles in
    /// their order, those that were cut in pieces; then what was sewn behind the cut.
    pub mesh: Mesh,
    /// The landmarks, those of lips or lids that were cut apart on their own rim.
    pub landmarks: Landmarks,
    /// `[V', 3]`: old vertices and their shares, sum 1, of which each vertex is a mixture. Vertices
    /// behind the cut take what lies before them at the rim.
    pub vertex_sources: Vec<[(u32, f32); 3]>,
    /// `[F']`.
    pub triangle_sources: Vec<TriangleSource>,
    /// From here on vertices lie behind the cut.
    pub first_inside_vertex: usize,
    /// From here on triangles lie behind the cut and have the colour of what is before them: inner sides of lips and lids,
    /// and the rest of an eyeball.
    pub first_lining_triangle: usize,
    /// From here on triangles are those of the mouth's inside behind the lips, where a mouth was opened.
    pub first_inside_triangle: usize,
    /// Vertices of the upper lip's rim from the subject's right corner to the left one, where a mouth was opened.
    pub upper_rim: Vec<u32>,
    /// The same of the lower lip; both rims share their ends.
    pub lower_rim: Vec<u32>,
}

impl OpenedFace {
    /// How the new mesh is prepared where `face` is the old one.
    pub fn face_options(&self, face: &Face) -> FaceOptions {
        let mut options = face.options.clone();
        options.landmarks = Some(LandmarkSource::from(&self.landmarks));
        options.fixed.clear();
        let names = &mut options.parts.names.of_vertex;
        if !names.is_empty() {
            let new = &self.vertex_sources[names.len()..];
            let like: Vec<u32> = new.iter().map(|from| names[from[0].0 as usize]).collect();
            names.extend(like);
        }
        options
    }
}
