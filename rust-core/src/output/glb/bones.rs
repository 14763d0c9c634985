//! The bones of the head and the eyes, and how they turn with a take.

use glam::{DMat3, DMat4, DQuat, DVec3, Quat};
use ndarray::Axis;
use serde_json::{Value, json};

use super::{
    animation::{Track, is_turning},
    buffer::Buffer,
};
use crate::{
    Result,
    mesh::glb_chunks,
    motion::Life,
    output::scene::{Scene, hinges},
};

/// Rigify's last bone of the spine, which is the head.
const RIGIFY: &str = "spine.006";
/// The head in MikuMikuDance.
const MMD: &str = "頭";

/// Words that may stand beside "eye" and its side in the name of an eye bone.
const BESIDE_EYE: [&str; 10] = [
    "adj",
    "base",
    "bip",
    "cc",
    "def",
    "face",
    "facial",
    "head",
    "j",
    "mixamorig",
];

/// A track that turns the head bone with the head of a take. `faces`: nodes that show the face. `None` if the head is
/// still or the file has no head bone.
///
/// # Errors
/// Those of the landmarks' alignment.
pub(super) fn turn_head(
    document: &mut Value,
    place: (&mut Buffer, usize),
    scene: &Scene<'_>,
    faces: &[usize],
) -> Result<Option<Track>> {
    let Some(life) = scene.life.filter(|life| is_turning(life)) else {
        return Ok(None);
    };
    let Some(node) = head_bone(document, faces) else {
        return Ok(None);
    };
    let turns = life.head.outer_iter();
    let turns = turns.map(|turn| [turn[0], turn[1], turn[2]]).collect();
    turn(document, place, scene, (node, turns))
}

/// Tracks that turn the eye bones with the gaze of a take; none if the eyes are still or the file has no such bones.
///
/// # Errors
/// Those of the landmarks' alignment.
pub(super) fn turn_eyes(
    document: &mut Value,
    (buffer, times): (&mut Buffer, usize),
    scene: &Scene<'_>,
) -> Result<Vec<Track>> {
    let looks = |life: &&Life| life.gaze.iter().any(|x| *x != 0.0);
    let (Some(life), Some(bones)) = (scene.life.filter(looks), eye_bones(document)) else {
        return Ok(Vec::new());
    };
    let mut tracks = Vec::new();
    for (eye, node) in bones.into_iter().enumerate() {
        let angles = life.gaze.index_axis(Axis(1), eye);
        let turns = angles.outer_iter().map(|look| {
            let turn = Quat::from_rotation_y(look[0]) * Quat::from_rotation_x(-look[1]);
            turn.to_scaled_axis().to_array()
        });
        tracks.extend(turn(
            document,
            (&mut *buffer, times),
            scene,
            (node, turns.collect()),
        )?);
    }
    Ok(tracks)
}

/// Whether a file has a bone for each eye. `source`: the bytes of a GLB.
pub fn has_eye_bones(source: &[u8]) -> bool {
    let json = glb_chunks(source).ok().map(|(json, _)| json);
    let document: Option<Value> = json.and_then(|json| serde_json::from_slice(json).ok());
    document.is_some_and(|document| eye_bones(&document).is_some())
}

/// The track of a bone. `turns` `[T]`: its rotation vectors about the axes of the face, in radians.
fn turn(
    document: &mut Value,
    (buffer, times): (&mut Buffer, usize),
    scene: &Scene<'_>,
    (node, turns): (usize, Vec<[f32; 3]>),
) -> Result<Option<Track>> {
    let above = DMat3::from_mat4(world_above(document, node));
    if above.determinant().abs() <= f64::MIN_POSITIVE {
        return Ok(None);
    }
    let rest = separate(&mut document["nodes"][node]);
    let to_mesh = hinges(scene)?;
    let turns = turns.into_iter().flat_map(|turn| {
        let turn = DVec3::from_array(to_mesh.rotate(turn).map(f64::from));
        let below = above.inverse() * DMat3::from_quat(DQuat::from_scaled_axis(turn)) * above;
        let turned = DQuat::from_mat3(&below).normalize() * rest;
        turned.normalize().as_quat().to_array()
    });
    let turns: Vec<f32> = turns.collect();
    let output = buffer.floats(&turns, "VEC4", None)?;
    Ok(Some(Track {
        sampler: json!({"input": times, "output": output, "interpolation": "LINEAR"}),
        node,
        path: "rotation",
    }))
}

/// The node of the head bone: by the humanoid of a VRM, or else by name among the joints of the face's skin.
fn head_bone(document: &Value, faces: &[usize]) -> Option<usize> {
    let skins = faces
        .iter()
        .filter_map(|face| number(&document["nodes"][*face]["skin"]));
    let joints = joints(document, skins);
    let named = |is: &dyn Fn(&str) -> bool| joints.iter().find(|(_, name)| is(name));
    let by_name = || {
        let named = named(&is_head).or_else(|| named(&|name| name.ends_with(RIGIFY)));
        named.map(|(node, _)| *node)
    };
    humanoid_bone(document, "head").or_else(by_name)
}

/// The nodes of the bones of the right and the left eye, by the humanoid of a VRM, or else by name among all joints.
fn eye_bones(document: &Value) -> Option<[usize; 2]> {
    let skins = document["skins"].as_array().map_or(0, Vec::len);
    let joints = joints(document, 0..skins);
    let bone = |vrm: &str, is_left: bool| {
        let named = || {
            joints
                .iter()
                .find(|(_, name)| eye_side(name) == Some(is_left))
        };
        humanoid_bone(document, vrm).or_else(|| named().map(|(node, _)| *node))
    };
    Some([bone("rightEye", false)?, bone("leftEye", true)?])
}

/// The node of a bone in the humanoid of a VRM 1.0 or VRM 0.
fn humanoid_bone(document: &Value, name: &str) -> Option<usize> {
    let extensions = &document["extensions"];
    let new = number(&extensions["VRMC_vrm"]["humanoid"]["humanBones"][name]["node"]);
    let bones = extensions["VRM"]["humanoid"]["humanBones"].as_array();
    let old = || {
        let mut bones = bones.into_iter().flatten();
        number(&bones.find(|bone| bone["bone"] == name)?["node"])
    };
    let node = new.or_else(old);
    node.filter(|node| document["nodes"][*node].is_object())
}

/// The joints of some skins with their names.
fn joints(document: &Value, skins: impl Iterator<Item = usize>) -> Vec<(usize, &str)> {
    let all = skins.flat_map(|skin| document["skins"][skin]["joints"].as_array());
    let named = all.flatten().filter_map(|joint| {
        let node = number(joint)?;
        Some((node, document["nodes"][node]["name"].as_str()?))
    });
    named.collect()
}

fn number(value: &Value) -> Option<usize> {
    value.as_u64().map(|n| n as usize)
}

/// Whether a bone is the head by its name: Head, mixamorig:Head, J_Bip_C_Head, CC_Base_Head, `Bip001 Head`, head.x,
/// Head_06.
fn is_head(name: &str) -> bool {
    if name == MMD {
        return true;
    }
    let is_suffix = |word: &String| word == "x" || word.parse::<u32>().is_ok();
    let words = words(name);
    let last = words.iter().rev().find(|word| !is_suffix(word));
    last.is_some_and(|word| word == "head")
}

/// Whether a bone is the left eye, or the right one, by its name: LeftEye, mixamorig:RightEye, CC_Base_L_Eye, `eye.R`,
/// J_Adj_L_FaceEye. `None` if it is none, such as a lid.
fn eye_side(name: &str) -> Option<bool> {
    let (mut has_eye, mut is_left) = (false, None);
    for word in words(name) {
        match &*word {
            "eye" => has_eye = true,
            "l" | "left" => is_left = Some(true),
            "r" | "right" => is_left = Some(false),
            other if BESIDE_EYE.contains(&other) || other.parse::<u32>().is_ok() => {}
            _ => return None,
        }
    }
    is_left.filter(|_| has_eye)
}

/// The words of a name in lower case, which separators and capital letters divide.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = ' ';
    for letter in name.chars() {
        let starts = letter.is_uppercase() && before.is_lowercase();
        if !letter.is_alphanumeric() || starts {
            words.push(String::new());
        }
        if letter.is_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.extend(letter.to_lowercase());
        }
        before = letter;
    }
    words.retain(|word| !word.is_empty());
    words
}

/// The transform of all nodes above a node.
fn world_above(document: &Value, node: usize) -> DMat4 {
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let parent_of = |child: usize| {
        let holds = |node: &Value| {
            let children = node["children"].as_array().into_iter().flatten();
            children
                .into_iter()
                .any(|other| other.as_u64() == Some(child as u64))
        };
        nodes.iter().position(holds)
    };
    let (mut world, mut below) = (DMat4::IDENTITY, node);
    // The reader refuses nodes in a circle within the scene; others end here.
    for _ in 0..nodes.len() {
        let Some(parent) = parent_of(below) else {
            break;
        };
        world = matrix(&nodes[parent]) * world;
        below = parent;
    }
    world
}

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let all = value.as_array()?.iter().map(Value::as_f64);
    <[f64; N]>::try_from(all.collect::<Option<Vec<f64>>>()?).ok()
}

fn matrix(node: &Value) -> DMat4 {
    if let Some(matrix) = numbers::<16>(&node["matrix"]) {
        return DMat4::from_cols_array(&matrix);
    }
    let scale = numbers(&node["scale"]).map_or(DVec3::ONE, DVec3::from_array);
    let place = numbers(&node["translation"]).map_or(DVec3::ZERO, DVec3::from_array);
    DMat4::from_scale_rotation_translation(scale, rotation(node), place)
}

fn rotation(node: &Value) -> DQuat {
    let rotation = numbers(&node["rotation"]).map(DQuat::from_array);
    let is_turn = |rotation: &DQuat| rotation.length_squared() > 0.0;
    rotation
        .filter(is_turn)
        .map_or(DQuat::IDENTITY, DQuat::normalize)
}

/// The rotation of a node at rest. A matrix becomes a scale, a rotation and a translation, because animations move only
/// these.
fn separate(node: &mut Value) -> DQuat {
    if node["matrix"].is_array() {
        let (scale, rotation, place) = matrix(node).to_scale_rotation_translation();
        if let Some(fields) = node.as_object_mut() {
            fields.remove("matrix");
        }
        node["scale"] = json!(scale.as_vec3().to_array());
        node["rotation"] = json!(rotation.as_quat().to_array());
        node["translation"] = json!(place.as_vec3().to_array());
    }
    rotation(node)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_are_told_by_their_names() {
        for name in [
            "Head",
            "head",
            "mixamorig:Head",
            "mixamorigHead",
            "J_Bip_C_Head",
            "CC_Base_Head",
            "Bip001 Head",
            "head.x",
            "Head_06",
            "DEF-head",
            "頭",
        ] {
            assert!(is_head(name), "{name}");
        }
        for name in [
            "HeadTop_End",
            "forehead",
            "head_end",
            "Neck",
            "spine.006",
            "Wolf3D_Hair",
            "",
        ] {
            assert!(!is_head(name), "{name}");
        }
    }

    #[test]
    fn eyes_are_told_by_their_names_and_lids_are_not() {
        for (left, right) in [
            ("LeftEye", "RightEye"),
            ("mixamorig:LeftEye", "mixamorig:RightEye"),
            ("CC_Base_L_Eye", "CC_Base_R_Eye"),
            ("eye.L", "eye.R"),
            ("J_Adj_L_FaceEye", "J_Adj_R_FaceEye"),
            ("eye_l_02", "eye_r_02"),
        ] {
            assert_eq!(
                (eye_side(left), eye_side(right)),
                (Some(true), Some(false)),
                "{left}"
            );
        }
        for name in [
            "eyelid.L",
            "Left_Eye_Lid",
            "eyebrow_l",
            "eye",
            "LeftHand",
            "FaceEyeSetL_end",
        ] {
            assert_eq!(eye_side(name), None, "{name}");
        }
    }

    #[test]
    fn the_humanoid_of_a_vrm_comes_before_names() {
        let mut document = json!({
            "nodes": [{"mesh": 0, "skin": 0}, {"name": "Neck"}, {"name": "Head"}, {"name": "DEF-spine.006"}],
            "skins": [{"joints": [1, 2, 3]}],
        });
        assert_eq!(head_bone(&document, &[0]), Some(2));
        document["nodes"][2]["name"] = json!("Skull");
        assert_eq!(head_bone(&document, &[0]), Some(3));
        document["extensions"] =
            json!({"VRM": {"humanoid": {"humanBones": [{"bone": "head", "node": 1}]}}});
        assert_eq!(head_bone(&document, &[]), Some(1));
        document["extensions"] =
            json!({"VRMC_vrm": {"humanoid": {"humanBones": {"head": {"node": 2}}}}});
        assert_eq!(head_bone(&document, &[]), Some(2));
    }
}
