//! Binary glTF 2.0 of a speaking mesh: morph targets, their weights over time, and head rotations.
//!
//! If the mesh came from a GLB, `onto` adds targets and an animation to that file, and materials,
//! bones and everything else stay. Any other mesh gets a new file from `alone`. Both write into a
//! `Buffer` and return a `Document`.

mod alone;
mod animation;
mod bones;
mod buffer;
mod bytes;
mod document;
mod layout;
mod onto;
mod weight_tracks;

use std::{io::Write, path::Path};

pub(super) use self::{
    animation::{Track, animation, times},
    bones::has_eye_bones,
    buffer::Buffer,
    document::{Bound, Document, write_document},
};
use super::{scene::Scene, targets::Targets};
use crate::Result;

/// Writes a scene with its targets at `path`.
///
/// # Errors
/// Those of [`document`] and of the writer.
pub(super) fn write_glb(
    file: (&mut impl Write, &Path),
    scene: &Scene<'_>,
    targets: &Targets,
) -> Result<()> {
    write_document(file, document(scene, targets)?)
}

/// A scene with its targets. If the targets have no frames, it gets no animation.
///
/// # Errors
/// `InvalidInput` if the mesh was not read from the source, or if the source shows a mesh twice.
pub(super) fn document(scene: &Scene<'_>, targets: &Targets) -> Result<Document> {
    match scene.glb() {
        Some(source) => onto::add(source, scene, targets),
        None => alone::document(scene, targets),
    }
}

#[cfg(test)]
mod tests;
