//! The options with which a face is prepared.

use crate::{
    conditions::Controls,
    mesh::{Axis, FixedLandmark, LandmarkSource, PartChoices},
};

/// What the caller says about a face before it is prepared.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceOptions {
    /// Landmarks from the caller; `None` lets the library find them.
    pub landmarks: Option<LandmarkSource>,
    /// The object of [`FaceOptions::parts`] on which the library looks for the face; `None` is the whole mesh. Where a file
    /// has several heads, it says which one speaks.
    pub head: Option<String>,
    /// Landmarks that stay where the caller puts them; the others follow.
    pub fixed: Vec<FixedLandmark>,
    /// The axis out of the face: +z in OBJ and glTF, −y in Blender. The library finds faces that
    /// are turned any way. The axes decide where several places look alike.
    pub forward: Axis,
    /// The axis to the top of the head.
    pub up: Axis,
    /// The roles that the caller gives to parts of the mesh. The library recognises the other parts
    /// by their shape and place.
    pub parts: PartChoices,
    /// A skin with more vertices than this is solved on a proxy with this many vertices. `None`
    /// solves it on all of its own vertices, however many there are.
    pub proxy: Option<usize>,
    /// The settings of the controls that act on a face.
    pub controls: Controls,
}

/// Default number of vertices of the proxy for a large skin.
pub const DEFAULT_PROXY: usize = 10_000;

impl Default for FaceOptions {
    fn default() -> Self {
        FaceOptions {
            landmarks: None,
            head: None,
            fixed: Vec::new(),
            forward: Axis::PosZ,
            up: Axis::PosY,
            controls: Controls::default(),
            parts: PartChoices::default(),
            proxy: Some(DEFAULT_PROXY),
        }
    }
}
