//! Binary glTF 2.0 of a mesh that speaks: morph targets, their weights over time, and the turns of the head.
//!
//! A mesh that came from a GLB keeps its file: materials, bones and all else stay, targets and an animation are added
//! (`onto`). Any other mesh gets a file of its own (`alone`). Both write into a `Buffer` and give a `Document`.

mod alone;
mod animation;
mod buffer;
mod document;
mod layout;
mod onto;

use std::{io::Write, path::Path};

pub(super) use self::{
    animation::{Track, animation, times},
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

/// A scene with its targets; where they do not play, without any animation of ours.
///
/// # Errors
/// `InvalidInput` if the source is not that of the mesh or shows one of its meshes twice.
pub(super) fn document(scene: &Scene<'_>, targets: &Targets) -> Result<Document> {
    match scene.glb() {
        Some(source) => onto::add(source, scene, targets),
        None => alone::document(scene, targets),
    }
}

#[cfg(test)]
mod tests;
