//! Writes a mesh as an avatar.

use std::{io::Write, path::Path};

use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};

use super::{
    expressions::{Existing, expressions, shapes_of_expressions},
    new_groups, old_groups,
    skeleton::skeleton,
};
use crate::{
    Error, Result,
    face::Rig,
    job::Unfinished,
    mesh::{Landmarks, Mesh},
    output::{
        glb::{Document, document, write_document},
        mesh_targets::with_file_targets,
        scene::{Scene, hinges},
        targets::Targets,
    },
};

/// A mesh axis within this angle of one of VRM's axes counts as that axis.
const UPRIGHT_DEGREES: f64 = 15.0;
/// A head whose size lies between these multiples of a human head's keeps its size.
const SIZES: (f64, f64) = (0.5, 2.0);

/// Writes a mesh with the shapes of its rig as a VRM: presets, and ARKit's shapes under their names
/// in Perfect Sync.
///
/// `source`: the bytes of the file that the mesh was read from. If it is a VRM (1.0 or 0), all
/// else in it stays. New expressions replace those of the same name, and the names of the replaced
/// ones are returned. In any other GLB all else stays too, but moves below the head bone of the
/// smallest skeleton that VRM 1.0 allows. A mesh without a GLB gets the same skeleton.
///
/// # Errors
/// `ShapeMismatch` if the rig is not the mesh's, `InvalidInput` for a GLB that has bones but is no
/// VRM, or that is not the mesh's, `Io` if the file cannot be written.
pub fn write_avatar(
    path: &Path,
    rig: &Rig,
    (mesh, landmarks): (&Mesh, &Landmarks),
    source: Option<&[u8]>,
) -> Result<Vec<String>> {
    rig.check_mesh(mesh)?;
    let scene = Scene {
        mesh,
        landmarks: &landmarks.positions,
        life: None,
        source,
        sound: None,
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let (avatar, replaced) = avatar(rig, &scene, &name)?;
    let (unfinished, mut file) = Unfinished::create(path)?;
    write_document((&mut file, path), avatar)?;
    file.flush().map_err(Error::io(path))?;
    drop(file);
    unfinished.finish()?;
    Ok(replaced)
}

/// The document with the new expressions, and the names of the expressions that they replaced.
pub(super) fn avatar(rig: &Rig, scene: &Scene<'_>, name: &str) -> Result<(Document, Vec<String>)> {
    let (rig, file_targets) = with_file_targets(rig, scene.glb())?;
    let targets = Targets::of_rig(&rig, shapes_of_expressions(), scene.landmarks);
    let targets = targets.on_file_targets(&file_targets);
    let mut avatar = document(scene, &targets)?;
    let extensions = &avatar.json["extensions"];
    if !extensions["VRMC_vrm"].is_object() && !extensions["VRM"].is_object() {
        stand_on_bones(&mut avatar.json, scene, name)?;
    }
    let replaced = add_expressions(&mut avatar, &targets, Existing::Replace)?;
    Ok((avatar, replaced))
}

/// Adds expressions that move the targets of a document, if it is an avatar of VRM 1.0 or VRM 0. Returns
/// the names of those that were replaced.
///
/// # Errors
/// `InvalidInput` if the expressions of the avatar are none.
pub(crate) fn add_expressions(
    avatar: &mut Document,
    targets: &Targets,
    existing: Existing,
) -> Result<Vec<String>> {
    let place = |shape: &str| {
        targets
            .shapes
            .iter()
            .position(|target| target.name == shape && !target.moved.is_empty())
    };
    let expressions = expressions(|shape| place(shape).is_some());
    let extensions = &avatar.json["extensions"];
    if extensions["VRMC_vrm"].is_object() {
        new_groups::add(avatar, (&expressions, existing), place)
    } else if extensions["VRM"].is_object() {
        old_groups::add(avatar, (&expressions, existing), place)
    } else {
        Ok(Vec::new())
    }
}

/// Puts all nodes of the scene below the head bone of the smallest skeleton that VRM 1.0 allows.
fn stand_on_bones(document: &mut Value, scene: &Scene<'_>, name: &str) -> Result<()> {
    if document["skins"]
        .as_array()
        .is_some_and(|skins| !skins.is_empty())
    {
        return Err(Error::InvalidInput(
            "expected a VRM, which says which bone is which, or a mesh without bones, got a GLB with bones that is no VRM; write it as a VRM \
             first, as Blender's VRM add-on does"
                .into(),
        ));
    }
    if document
        .get("extensions")
        .is_some_and(|all| !all.is_object())
    {
        let message = "glTF: expected an object of extensions, got something else";
        return Err(Error::InvalidInput(message.into()));
    }
    let number = document["scene"].as_u64().unwrap_or(0) as usize;
    let shown = document["scenes"][number]["nodes"].take();
    let count = document["nodes"].as_array().map_or(0, Vec::len);
    let placed = placed(scene, &shown)?;
    let bones = skeleton(count + 1, &[count]);
    if let Some(nodes) = document["nodes"].as_array_mut() {
        nodes.push(placed);
        nodes.extend(bones.nodes);
    }
    document["scenes"][number]["nodes"] = json!([count + 1]);
    document["extensions"]["VRMC_vrm"] = json!({
        "specVersion": "1.0",
        "meta": {
            "name": name, "authors": ["unknown"], "licenseUrl": "https://vrm.dev/licenses/1.0/",
        },
        "humanoid": {"humanBones": bones.human_bones},
    });
    let used = document["extensionsUsed"].as_array_mut();
    match used {
        Some(used) => used.push(json!("VRMC_vrm")),
        None => document["extensionsUsed"] = json!(["VRMC_vrm"]),
    }
    Ok(())
}

/// A node that brings a mesh to the size and the axes of VRM and moves the point between the jaw's
/// hinges to the head bone.
fn placed(scene: &Scene<'_>, below: &Value) -> Result<Value> {
    let (to_mesh, to_head) = (hinges(scene)?, hinges(scene)?.inverse());
    let turn = upright(DMat3::from_cols_array_2d(&to_head.rotation).transpose());
    let scale = if (SIZES.0..SIZES.1).contains(&to_mesh.scale) {
        1.0
    } else {
        to_head.scale
    };
    let origin = DVec3::from_array(to_mesh.translation);
    let rotation = DQuat::from_mat3(&turn);
    let mut node = json!({
        "name": "Face",
        "children": below,
        "translation": (-scale * (turn * origin)).as_vec3().to_array(),
    });
    if scale != 1.0 {
        node["scale"] = json!(vec![scale as f32; 3]);
    }
    if turn != DMat3::IDENTITY {
        node["rotation"] = json!(rotation.as_quat().to_array());
    }
    Ok(node)
}

/// Snaps a turn to the one that maps axes onto axes, if that one is near. Otherwise returns it
/// unchanged.
fn upright(turn: DMat3) -> DMat3 {
    let least = UPRIGHT_DEGREES.to_radians().cos();
    let snapped = turn
        .to_cols_array()
        .map(|x| if x.abs() >= least { x.signum() } else { 0.0 });
    let snapped = DMat3::from_cols_array(&snapped);
    if snapped.determinant() == 1.0 {
        snapped
    } else {
        turn
    }
}
