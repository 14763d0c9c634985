//! Results as files: npz for numpy, pc2 and mdd point caches, GLB and USD for browsers, engines and studios, VRM for avatars, JSON reports.
//!
//! Every file is written beside its place under another name and renamed when complete, so that a
//! full disk or a failure leaves what was there before. Frames are streamed: an hour of animation
//! needs no more memory than the block that is being written.

mod blend_weights;
mod cache;
mod clip_file;
mod format;
mod glb;
mod landmark_motion;
mod mdd;
mod motion_file;
mod npz;
mod numpy;
mod opened_obj;
mod pc2;
mod report;
mod rig;
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
pub use clip_file::ClipFile;
pub use format::Format;
pub use landmark_motion::{LandmarkMotion, read_landmark_motion, read_life, read_weights};
pub use motion_file::{MotionFile, check_motion_path};
pub use opened_obj::write_opened_obj;
pub use report::{Report, warnings_of_sound};
pub use rig::{read_rig, write_rig, write_rig_folder};
pub use surface_frames::{check_new_folder, write_surface_frames};
pub use take_shapes::TakeShapes;
pub use take_weights::TakeWeights;
pub use vertex_motion::{VertexMotion, read_vertex_motion};
pub use vrm::{VrmNames, write_avatar};

use ndarray::ArrayView2;

use self::{scene::Scene, targets::Targets};
use crate::{
    Error, Result,
    job::write_atomically,
    mesh::Mesh,
    motion::{LandmarkClip, Life, Motion, MotionKind},
    spread::Animation,
};

/// Writes an animation in the format that the extension of `path` names; see [`ClipFile`].
///
/// # Errors
/// Those of [`ClipFile`]; then nothing is left.
pub fn write_animation(
    path: &Path,
    animation: &Animation,
    life: Option<&Life>,
    mesh: &Mesh,
) -> Result<()> {
    ClipFile::new(path)?.write_whole(animation, life, mesh)
}

/// A whole animation as the bytes of a GLB, where there are no files. `source`: the bytes of the file that the mesh was
/// read from, of which a GLB keeps its materials, bones and all else, other files their texture coordinates.
///
/// # Errors
/// `InvalidInput` if the source is not that of the mesh or shows one of its meshes twice; those of
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
    let targets = Targets::of_clip(&animation.vertices, &animation.landmarks_neutral)?;
    let mut bytes = Vec::new();
    glb::write_glb((&mut bytes, Path::new("GLB")), &scene, &targets)?;
    Ok(bytes)
}

/// Writes motion that is whole into a [`MotionFile`]; `landmarks`: on the mean face ([`Motion::on_mean_face`]).
///
/// # Errors
/// Those of [`MotionFile`]; then nothing is left.
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

/// Writes by which share each vertex attends to each landmark as npz: `attention` `[V, 68]`.
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
