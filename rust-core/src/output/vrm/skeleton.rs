//! The smallest skeleton that VRM 1.0 allows, in T-pose.

use glam::Vec3;
use serde_json::{Map, Value, json};

use crate::mesh::canonical_landmarks;

/// A bone, the number of its parent, and its offset from the parent, metres: +x to the left, +y up,
/// +z to the front.
type Bone = (&'static str, Option<usize>, [f32; 3]);

const BONES: [Bone; 15] = [
    ("hips", None, [0.0, 0.9, 0.0]),
    ("spine", Some(0), [0.0, 0.12, 0.0]),
    ("head", Some(1), [0.0, 0.5, 0.0]),
    ("leftUpperLeg", Some(0), [0.09, -0.05, 0.0]),
    ("leftLowerLeg", Some(3), [0.0, -0.4, 0.0]),
    ("leftFoot", Some(4), [0.0, -0.38, 0.0]),
    ("rightUpperLeg", Some(0), [-0.09, -0.05, 0.0]),
    ("rightLowerLeg", Some(6), [0.0, -0.4, 0.0]),
    ("rightFoot", Some(7), [0.0, -0.38, 0.0]),
    ("leftUpperArm", Some(1), [0.17, 0.32, 0.0]),
    ("leftLowerArm", Some(9), [0.26, 0.0, 0.0]),
    ("leftHand", Some(10), [0.24, 0.0, 0.0]),
    ("rightUpperArm", Some(1), [-0.17, 0.32, 0.0]),
    ("rightLowerArm", Some(12), [-0.26, 0.0, 0.0]),
    ("rightHand", Some(13), [-0.24, 0.0, 0.0]),
];
const HEAD: usize = 2;
/// Landmarks around both eyes.
const EYES: std::ops::Range<usize> = 36..48;

/// The point between the eyes, relative to the head bone, metres. The head bone lies between the
/// jaw's hinges.
pub(super) fn eyes_from_head() -> [f32; 3] {
    let eyes = canonical_landmarks()[EYES].iter().map(|p| Vec3::from(*p));
    let middle = eyes.sum::<Vec3>() / EYES.len() as f32;
    [0.0, middle.y, middle.z]
}

/// Bones as nodes of a file.
pub(super) struct Skeleton {
    /// The first one is the root of all others.
    pub nodes: Vec<Value>,
    /// `humanBones` of VRM.
    pub human_bones: Value,
    /// Number of the head's node in the file.
    pub head: usize,
}

/// The bones as nodes that follow `first` others. The nodes `below_head` become children of the
/// head.
pub(super) fn skeleton(first: usize, below_head: &[usize]) -> Skeleton {
    let mut human_bones = Map::new();
    let nodes = BONES.iter().enumerate().map(|(n, (name, _, place))| {
        human_bones.insert((*name).to_owned(), json!({"node": first + n}));
        let below = BONES.iter().enumerate();
        let below = below.filter(|(_, (_, above, _))| *above == Some(n));
        let mut below: Vec<usize> = below.map(|(n, _)| first + n).collect();
        if n == HEAD {
            below.extend(below_head);
        }
        let mut node = json!({"name": name, "translation": place});
        if !below.is_empty() {
            node["children"] = json!(below);
        }
        node
    });
    let nodes = nodes.collect();
    Skeleton {
        nodes,
        human_bones: Value::Object(human_bones),
        head: first + HEAD,
    }
}
