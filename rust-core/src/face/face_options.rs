//! What a caller knows of a face.

use crate::{
    conditions::Controls,
    mesh::{Axis, FixedLandmark, LandmarkSource, PartChoices},
};

/// What is known of a face before it is prepared.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceOptions {
    /// Landmarks from the caller; `None` lets the library find them.
    pub landmarks: Option<LandmarkSource>,
    /// Landmarks that stay where the caller puts them; the others follow.
    pub fixed: Vec<FixedLandmark>,
    /// The axis out of the face: +z in OBJ and glTF, −y in Blender. Faces turned any way are found;
    /// the axes decide where several places look alike.
    pub forward: Axis,
    /// The axis to the top of the head.
    pub up: Axis,
    /// What the caller says of the mesh's parts; the others are told by shape and place.
    pub parts: PartChoices,
    /// A skin of more vertices is worked on through a proxy of so many; `None` works on every
    /// vertex, however many.
    pub proxy: Option<usize>,
    /// What the controls of faces are set to.
    pub controls: Controls,
}

/// Vertices of the proxy on which large skins are worked on.
pub const DEFAULT_PROXY: usize = 10_000;

impl Default for FaceOptions {
    fn default() -> Self {
        FaceOptions {
            landmarks: None,
            fixed: Vec::new(),
            forward: Axis::PosZ,
            up: Axis::PosY,
            controls: Controls::default(),
            parts: PartChoices::default(),
            proxy: Some(DEFAULT_PROXY),
        }
    }
}
