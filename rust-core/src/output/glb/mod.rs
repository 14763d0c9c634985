//! Binary glTF 2.0 of a mesh that speaks: morph targets, their weights over time, and the turns of the head.
//!
//! A mesh that came from a GLB keeps its file: materials, bones and all else stay, targets and an animation are added
//! (`onto`). Any other mesh gets a file of its own (`alone`). Both write into a `Buffer`.

mod alone;
mod animation;
mod buffer;
mod layout;
mod onto;

use std::{io::Write, path::Path};

use serde_json::Value;

pub(super) use self::{
    animation::{Track, animation, times},
    buffer::Buffer,
};
use super::{scene::Scene, targets::Targets};
use crate::{Error, Result};

/// A file in the making.
pub(super) struct Document {
    pub json: Value,
    pub binary: Vec<u8>,
    /// Where the shapes stand.
    pub bound: Vec<Bound>,
}

/// Which shapes a mesh of the file has become targets of.
pub(super) struct Bound {
    pub node: usize,
    pub mesh: usize,
    /// Targets that the mesh had before.
    pub before: usize,
    /// Numbers of the shapes, a target each behind those.
    pub shapes: Vec<usize>,
}

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

/// Writes the file at `path`.
///
/// # Errors
/// `InvalidInput` for more than the format counts, and `Io` of the writer.
pub(super) fn write_document(
    (file, path): (&mut impl Write, &Path),
    document: Document,
) -> Result<()> {
    let mut json = document.json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = document.binary;
    binary.resize(binary.len().next_multiple_of(4), 0);
    let chunks = [(b"JSON", &json), (b"BIN\0", &binary)];
    let chunks = chunks.iter().filter(|(_, bytes)| !bytes.is_empty());
    let length = 12
        + chunks
            .clone()
            .map(|(_, bytes)| 8 + bytes.len())
            .sum::<usize>();
    let length = number(length)?;
    let mut write = |bytes: &[u8]| file.write_all(bytes).map_err(Error::io(path));
    write(b"glTF")?;
    write(&2u32.to_le_bytes())?;
    write(&length.to_le_bytes())?;
    for (kind, bytes) in chunks {
        write(&number(bytes.len())?.to_le_bytes())?;
        write(*kind)?;
        write(bytes)?;
    }
    Ok(())
}

/// The format counts its bytes in 32 bits.
fn number(bytes: usize) -> Result<u32> {
    u32::try_from(bytes).map_err(|_| {
        Error::InvalidInput(format!(
            "expected a GLB of less than 4 GB, got {bytes} bytes; write a shorter sound, or an .npz"
        ))
    })
}

#[cfg(test)]
mod tests;
