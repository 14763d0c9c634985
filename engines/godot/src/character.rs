//! The mesh and the bone that a face moves.

use anyface::{
    motion::WeightFrame,
    rig::{ARKIT, VISEMES},
};
use godot::{
    classes::{ArrayMesh, MeshInstance3D, Skeleton3D},
    prelude::*,
};

/// Remembers which weight drives which blend shape of a mesh.
#[derive(Default)]
pub struct Character {
    mesh: Option<InstanceId>,
    /// The index of a blend shape and the index of the weight that drives it. ARKit's weights come
    /// first, then the visemes.
    shapes: Vec<(i32, usize)>,
}

impl Character {
    /// Applies a frame to the blend shapes of the mesh and to the bone of the head.
    pub fn show(
        &mut self,
        frame: &WeightFrame,
        mesh: Option<&mut Gd<MeshInstance3D>>,
        skeleton: Option<&mut Gd<Skeleton3D>>,
        head_bone: &GString,
    ) -> Result<(), String> {
        if let Some(mesh) = mesh {
            if self.mesh != Some(mesh.instance_id()) {
                (self.mesh, self.shapes) = (Some(mesh.instance_id()), shapes_of(mesh)?);
            }
            for &(place, weight) in &self.shapes {
                let value = match weight.checked_sub(ARKIT.len()) {
                    None => frame.shapes[weight],
                    Some(viseme) => frame.visemes[viseme],
                };
                mesh.set_blend_shape_value(place, value);
            }
        }
        let Some(skeleton) = skeleton else {
            return Ok(());
        };
        let bone = skeleton.find_bone(head_bone);
        if bone < 0 {
            return Err(format!(
                "head_bone: expected a bone of {}, got {head_bone}",
                skeleton.get_name()
            ));
        }
        let rest = skeleton.get_bone_rest(bone).basis.get_quaternion();
        skeleton.set_bone_pose_rotation(bone, rest * rotation(frame.head));
        Ok(())
    }
}

/// The weights of a frame by name.
pub fn by_name(frame: &WeightFrame) -> VarDictionary {
    let shapes = ARKIT.iter().zip(frame.shapes);
    let all = shapes.chain(VISEMES.iter().zip(frame.visemes));
    all.map(|(name, weight)| (*name, weight)).collect()
}

/// Finds the blend shapes of a mesh that are named like ARKit's shapes. If the mesh has no
/// `jawOpen`, finds those named like visemes instead.
fn shapes_of(mesh: &Gd<MeshInstance3D>) -> Result<Vec<(i32, usize)>, String> {
    let array = mesh.get_mesh().and_then(|m| m.try_cast::<ArrayMesh>().ok());
    let array = array.ok_or("mesh: expected one with blend shapes, got another")?;
    let names_of_mesh: Vec<String> = (0..array.get_blend_shape_count())
        .map(|place| array.get_blend_shape_name(place).to_string())
        .collect();
    // Use only one kind: with both, the mouth would move twice.
    let names = if names_of_mesh.iter().any(|name| name == "jawOpen") {
        0..ARKIT.len()
    } else {
        ARKIT.len()..ARKIT.len() + VISEMES.len()
    };
    let all: Vec<&str> = ARKIT.iter().chain(VISEMES.iter()).copied().collect();
    let pairs = names_of_mesh
        .iter()
        .enumerate()
        .filter_map(|(place, name)| {
            let weight = names.clone().find(|&weight| all[weight] == name)?;
            Some((place as i32, weight))
        });
    let pairs: Vec<(i32, usize)> = pairs.collect();
    if pairs.is_empty() {
        return Err(format!(
            "mesh: expected blend shapes with names of ARKit (jawOpen, …) or visemes (viseme_aa, …), got {}; anyface rig \
             gives a mesh its shapes",
            names_of_mesh.join(", ")
        ));
    }
    Ok(pairs)
}

/// Turns a rotation vector in radians into a quaternion. Its axes are the face's left, up and
/// front. These are Godot's x, y and z if the face looks along +z.
fn rotation(vector: [f32; 3]) -> Quaternion {
    let turn = Vector3::from_array(vector);
    match turn.try_normalized() {
        Some(axis) => Quaternion::from_axis_angle(axis, turn.length()),
        None => Quaternion::IDENTITY,
    }
}
