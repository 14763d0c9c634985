//! Writes results to files: npz for numpy, pc2 and mdd point caches, GLB and USD for browsers,
//! engines and studios, VRM for avatars, JSON reports.
//!
//! Every file is written under another name in its folder and renamed when complete, so a full disk
//! or another failure leaves the old file in place. Frames are streamed into npz, pc2 and mdd: an
//! hour of animation needs no more memory than the block that is being written. Scenes (GLB, USD,
//! VRMA) keep the frames of ten minutes in memory until the last one, and more of them in a file.

mod blend_weights;
mod cache;
mod captured;
mod clip_file;
mod format;
mod glb;
mod landmark_motion;
mod mdd;
mod mesh_targets;
mod motion_file;
mod moved;
mod npz;
mod numpy;
mod opened_obj;
mod pc2;
mod report;
mod rig;
mod rig_glb;
mod rows;
mod scene;
mod surface_frames;
mod take_shapes;
mod take_weights;
mod targets;
mod usd;
mod vertex_motion;
mod vrm;

use std::path::Path;

pub use blend_weights::write_blend_weights;
pub use captured::{CapturedFace, read_captured_face};
pub use clip_file::ClipFile;
pub use format::Format;
pub use landmark_motion::{LandmarkMotion, read_landmark_motion, read_life, read_weights};
pub use mesh_targets::{MeshTargets, TargetNames, TargetReport};
pub use motion_file::{MotionFile, check_motion_path};
pub use opened_obj::write_opened_obj;
pub use report::{Report, warnings_of_sound};
pub use rig::{read_rig, write_rig, write_rig_folder};
pub use rig_glb::{ShapedObject, write_rig_glb};
pub use surface_frames::{check_new_folder, write_surface_frames};
pub use take_shapes::TakeShapes;
pub use take_weights::TakeWeights;
pub use vertex_motion::{VertexMotion, read_vertex_motion};
pub use vrm::{VrmNames, write_avatar};

use ndarray::ArrayView2;

use self::{scene::Scene, targets::Targets};
use crate::{
    Error, Result,
    deform::compression::compress,
    job::{SILENT, write_atomically},
    mesh::Mesh,
    motion::{LandmarkClip, Life, Motion, MotionKind},
    spread::Animation,
};

/// Writes an animation in the format that the extension of `path` names; see [`ClipFile`].
///
/// # Errors
/// Those of [`ClipFile`]. On an error no unfinished file is left.
pub fn write_animation(
    path: &Path,
    animation: &Animation,
    life: Option<&Life>,
    mesh: &Mesh,
) -> Result<()> {
    ClipFile::new(path)?.write_whole(animation, life, mesh)
}

/// A whole animation as the bytes of a GLB, for platforms without files.
///
/// `source`: the bytes of the file that the mesh was read from. From a GLB the result keeps the
/// materials, bones and everything else, from an OBJ or PLY the texture coordinates.
///
/// # Errors
/// `InvalidInput` if the mesh was not read from the source or the source shows a mesh twice; those of
/// [`crate::deform::compression::compress`].
pub fn glb_of(
    animation: &Animation,
    life: Option<&Life>,
    mesh: &Mesh,
    source: &[u8],
) -> Result<Vec<u8>> {
    let scene = Scene {
        mesh,
        landmarks: &animation.landmarks_neutral,
        life,
        source: Some(source),
        sound: None,
    };
    let landmarks = &animation.landmarks_neutral;
    let max_error = Targets::max_error(landmarks);
    let frames = animation.vertices.displacements.dim().0;
    let basis = compress(&animation.vertices, max_error, frames.max(1), SILENT)?;
    let targets = Targets::of_basis(basis, landmarks);
    let mut bytes = Vec::new();
    glb::write_glb((&mut bytes, Path::new("GLB")), &scene, &targets)?;
    Ok(bytes)
}

/// Writes a whole motion into a [`MotionFile`].
///
/// `landmarks`: the motion on the mean face ([`Motion::on_mean_face`]).
///
/// # Errors
/// Those of [`MotionFile`]. On an error no unfinished file is left.
pub fn write_motion(
    path: &Path,
    motion: &Motion,
    landmarks: &LandmarkClip,
    life: Option<&Life>,
) -> Result<()> {
    let is_weights = motion.kind() == MotionKind::Weights;
    let mut file = MotionFile::new(path, is_weights, motion.frames(), motion.fps())?;
    file.add(motion, landmarks, life)?;
    file.finish()
}

/// Writes as npz how strongly each vertex attends to each landmark: `attention` `[V, 68]`.
///
/// # Errors
/// `InvalidInput` for an extension other than npz, `Io` if the file cannot be written.
pub fn write_attention(path: &Path, attention: ArrayView2<'_, f32>) -> Result<()> {
    match Format::from_path(path)? {
        Format::Npz => write_atomically(path, |file| npz::write_attention(file, attention)),
        _ => Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .npz for attention",
            path.display()
        ))),
    }
}

/// Writes a mask `[V, T]` as npz: `mask` `[T, V]`.
///
/// # Errors
/// `InvalidInput` for an extension other than npz, `Io` if the file cannot be written.
pub fn write_mask(path: &Path, mask: ArrayView2<'_, f32>) -> Result<()> {
    match Format::from_path(path)? {
        Format::Npz => write_atomically(path, |file| npz::write_mask(file, mask.t())),
        _ => Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .npz for a mask",
            path.display()
        ))),
    }
}

#[cfg(test)]
mod tests;
