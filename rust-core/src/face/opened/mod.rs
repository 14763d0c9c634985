//! A face whose mouth or eyes were cut open, and the source of each of its pieces.

mod refine;
mod source;

use super::{Face, FaceOptions};
use crate::mesh::{LandmarkSource, Landmarks, Mesh};
pub(super) use refine::{FineMesh, mixed};
pub use source::TriangleSource;

/// A mesh whose lips or lids were one surface and can part now.
#[derive(Debug, Clone, PartialEq)]
pub struct OpenedFace {
    /// Old vertices keep their numbers and positions; new ones follow. Old triangles keep their
    /// order, and pieces replace those that were cut; the surface sewn behind the cut follows.
    pub mesh: Mesh,
    /// The landmarks. Those of lips or lids that were cut apart lie on their own rim.
    pub landmarks: Landmarks,
    /// `[V', 3]`: the old vertices that each vertex is a mixture of, and their shares, sum 1.
    /// Vertices behind the cut take the mixture of the rim in front of them.
    pub vertex_sources: Vec<[(u32, f32); 3]>,
    /// `[F']`: the source of each triangle.
    pub triangle_sources: Vec<TriangleSource>,
    /// Vertices from this number on lie behind the cut.
    pub first_inside_vertex: usize,
    /// Triangles from this number on lie behind the cut and have the colour of the surface in front
    /// of them: inner sides of lips and lids, and the rest of an eyeball.
    pub first_lining_triangle: usize,
    /// Triangles from this number on belong to the inside of the mouth behind the lips, where a
    /// mouth was opened.
    pub first_inside_triangle: usize,
    /// Vertices of the upper lip's rim from the subject's right corner to the left one, where a
    /// mouth was opened.
    pub upper_rim: Vec<u32>,
    /// The same for the lower lip. Both rims share their ends.
    pub lower_rim: Vec<u32>,
}

impl OpenedFace {
    /// The options with which to prepare the new mesh. `face`: the old face.
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
