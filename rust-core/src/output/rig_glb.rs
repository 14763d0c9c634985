//! Writes a mesh with all shapes of its rig as morph targets into the GLB that it came from.

use std::{io::Write, path::Path};

use serde::Serialize;

use super::{
    glb::{Document, document, write_document},
    mesh_targets::with_file_targets,
    scene::Scene,
    targets::Targets,
    vrm::{Existing, add_expressions},
};
use crate::{
    Error, Result,
    face::Rig,
    job::Unfinished,
    mesh::{Landmarks, Mesh},
};

/// An object of a GLB that has shapes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ShapedObject {
    /// Name of its node, or of its mesh if the node has none.
    pub name: String,
    /// How many shapes it got.
    pub new: usize,
    /// How many shapes it had already under their names. They stay as they are.
    pub kept: usize,
}

/// Writes a mesh with all shapes of its rig as morph targets.
///
/// `source`: the bytes of the file that the mesh was read from. All else in a GLB or VRM stays: bones, skins,
/// materials, pictures, animations, other meshes and targets. The object with the skin gets every
/// shape, also those that move nothing of it; every other object gets those that move it, such as teeth, lashes
/// and eyes. A shape that an object has already stays. In a VRM, expressions that move
/// nothing yet move the shapes. A mesh that came from no GLB gets a new one.
///
/// Returns the objects with shapes.
///
/// # Errors
/// `ShapeMismatch` if the rig is not the mesh's, `InvalidInput` for a GLB that is not the mesh's, `Io` if the file
/// cannot be written.
pub fn write_rig_glb(
    path: &Path,
    rig: &Rig,
    (mesh, landmarks): (&Mesh, &Landmarks),
    source: Option<&[u8]>,
) -> Result<Vec<ShapedObject>> {
    rig.check_mesh(mesh)?;
    let scene = Scene {
        mesh,
        landmarks: &landmarks.positions,
        life: None,
        source,
        sound: None,
    };
    let document = with_shapes(rig, &scene, landmarks)?;
    let objects = shaped_objects(&document);
    let (unfinished, mut file) = Unfinished::create(path)?;
    write_document((&mut file, path), document)?;
    file.flush().map_err(Error::io(path))?;
    drop(file);
    unfinished.finish()?;
    Ok(objects)
}

/// The document with the shapes.
pub(super) fn with_shapes(rig: &Rig, scene: &Scene<'_>, landmarks: &Landmarks) -> Result<Document> {
    let (rig, file_targets) = with_file_targets(rig, scene.glb())?;
    let targets = Targets::of_whole_rig(&rig, landmarks).on_file_targets(&file_targets);
    let mut document = document(scene, &targets)?;
    add_expressions(&mut document, &targets, Existing::Keep)?;
    Ok(document)
}

fn shaped_objects(document: &Document) -> Vec<ShapedObject> {
    let name = |list: &str, number: usize| document.json[list][number]["name"].as_str();
    let objects = document.bound.iter().map(|bound| {
        let name = name("nodes", bound.node).or_else(|| name("meshes", bound.mesh));
        ShapedObject {
            name: name.map_or_else(|| format!("node {}", bound.node), str::to_owned),
            new: bound.new,
            kept: bound.targets.len() - bound.new,
        }
    });
    objects.collect()
}
