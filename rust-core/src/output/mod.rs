//! Results as files: npz for numpy, pc2 and mdd point caches, JSON reports.
//!
//! Every file is written beside its place under another name and renamed when complete, so that a
//! full disk or a failure leaves what was there before. Frames are streamed: an hour of animation
//! needs no more memory than the block that is being written.

mod atomic;
mod blend_weights;
mod cache;
mod clip_file;
mod landmark_motion;
mod mdd;
mod npz;
mod opened_obj;
mod pc2;
mod report;
mod rig;
mod vertex_motion;

use std::path::Path;

pub use atomic::write_atomically;
pub use blend_weights::write_blend_weights;
pub use clip_file::ClipFile;
pub use landmark_motion::{LandmarkMotion, read_landmark_motion, read_life};
pub use opened_obj::write_opened_obj;
pub use report::{Report, warnings_of_sound};
pub use rig::{read_rig, write_rig, write_rig_folder};
pub use vertex_motion::{VertexMotion, read_vertex_motion};

use ndarray::ArrayView2;

use crate::{
    Error, Result,
    mesh::Mesh,
    motion::{LandmarkClip, Life},
    spread::{Animation, ClipStart, FrameSink, LandmarkTrack},
};

/// A kind of file that holds an animation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Arrays for numpy: displacements, landmarks, frame rate.
    Npz,
    /// Point cache 2: positions at every frame; Blender, 3ds Max, Maya.
    Pc2,
    /// Lightwave point cache: times and positions, big-endian; Blender, Cinema 4D, Houdini.
    Mdd,
}

impl Format {
    /// From the extension of a file name.
    ///
    /// # Errors
    /// `InvalidInput` for any other extension.
    pub fn from_path(path: &Path) -> Result<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        match extension.to_ascii_lowercase().as_str() {
            "npz" => Ok(Format::Npz),
            "pc2" => Ok(Format::Pc2),
            "mdd" => Ok(Format::Mdd),
            _ => Err(Error::InvalidInput(format!(
                "{}: expected a name that ends in .npz, .pc2 or .mdd, got {extension:?}",
                path.display()
            ))),
        }
    }
}

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
    let moved = &animation.vertices.displacements;
    let mut file = ClipFile::new(path)?.with_life(life);
    file.begin(&ClipStart {
        mesh,
        is_brought: false,
        frames: moved.dim().0,
        fps: animation.vertices.fps,
    })?;
    file.write(moved.view())?;
    file.finish(&LandmarkTrack {
        neutral: &animation.landmarks_neutral,
        displacements: animation.landmark_displacements.view(),
    })
}

/// Writes landmark motion as npz: `landmark_displacements` `[T, 68, 3]` in canonical metres, `fps`, and
/// `head` and `gaze` as [`Life`] has them.
///
/// # Errors
/// `InvalidInput` for an extension other than npz, `Io` if the file cannot be written.
pub fn write_motion(path: &Path, motion: &LandmarkClip, life: Option<&Life>) -> Result<()> {
    match Format::from_path(path)? {
        Format::Npz => write_atomically(path, |file| npz::write_motion(file, motion, life)),
        _ => Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .npz for landmark motion",
            path.display()
        ))),
    }
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

/// Writes any value as indented JSON.
///
/// # Errors
/// `Io` if the file cannot be written.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    write_atomically(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value)?;
        std::io::Write::write_all(file, b"\n")
    })
}

#[cfg(test)]
mod tests;
