//! Results as files: npz for numpy, pc2 and mdd point caches, JSON reports.
//!
//! Every file is written beside its place under another name and renamed when complete, so that a
//! full disk or a failure leaves what was there before. Frames are streamed: an hour of animation
//! needs no more memory than the block that is being written.

mod blend_weights;
mod cache;
mod clip_file;
mod format;
mod landmark_motion;
mod mdd;
mod npz;
mod numpy;
mod opened_obj;
mod pc2;
mod report;
mod rig;
mod surface_frames;
mod vertex_motion;

use std::path::Path;

pub use blend_weights::write_blend_weights;
pub use clip_file::ClipFile;
pub use format::Format;
pub use landmark_motion::{LandmarkMotion, read_landmark_motion, read_life, read_weights};
pub use opened_obj::write_opened_obj;
pub use report::{Report, warnings_of_sound};
pub use rig::{read_rig, write_rig, write_rig_folder};
pub use surface_frames::{check_new_folder, write_surface_frames};
pub use vertex_motion::{VertexMotion, read_vertex_motion};

use ndarray::ArrayView2;

use crate::{
    Error, Result,
    job::write_atomically,
    mesh::Mesh,
    motion::{LandmarkClip, Life, Motion},
    rig::SolvedWeights,
    spread::{Animation, ClipStart, FrameSink, LandmarkTrack},
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
    let moved = &animation.vertices.displacements;
    let mut file = ClipFile::new(path)?.with_life(life);
    file.begin(&ClipStart {
        mesh,
        frames: moved.dim().0,
        fps: animation.vertices.fps,
    })?;
    file.write(moved.view())?;
    file.finish(&LandmarkTrack {
        neutral: &animation.landmarks_neutral,
        displacements: animation.landmark_displacements.view(),
    })
}

/// Writes motion as npz: `landmark_displacements` `[T, 68, 3]` in canonical metres, which `landmarks` has
/// ([`Motion::on_mean_face`]), `fps`, and `head`, `gaze` and `tongue` as [`Life`] has them. Motion of weights has its `weights`
/// `[T, S]`, their `names` `[S]` and `together` `[T]` too, how far lips have to meet on whatever head shows it; it may go
/// to a .csv or .json as well, as [`write_blend_weights`] writes them, alone.
///
/// # Errors
/// `InvalidInput` for another extension; `Io` if the file cannot be written.
pub fn write_motion(
    path: &Path,
    motion: &Motion,
    landmarks: &LandmarkClip,
    life: Option<&Life>,
) -> Result<()> {
    let weights = match motion {
        Motion::Weights(clip) => Some(clip),
        Motion::Landmarks(_) | Motion::Codes(_) => None,
    };
    check_motion_path(path, weights.is_some())?;
    match weights {
        Some(clip) if !is_npz(path) => {
            let weights = SolvedWeights {
                names: clip.names.clone(),
                weights: clip.weights.clone(),
                residual: vec![0.0; clip.weights.nrows()],
                motion: vec![0.0; clip.weights.nrows()],
            };
            write_blend_weights(path, &weights, clip.fps)
        }
        _ => write_atomically(path, |file| {
            npz::write_motion(file, landmarks, weights, life)
        }),
    }
}

/// Checks that motion can be written under this name: .npz, and where it `is_weights` .csv and .json.
///
/// # Errors
/// `InvalidInput` for another extension.
pub fn check_motion_path(path: &Path, is_weights: bool) -> Result<()> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let expected = match is_weights {
        true => &["npz", "csv", "json"][..],
        false => &["npz"],
    };
    match expected.contains(&ending.to_ascii_lowercase().as_str()) {
        true => Ok(()),
        false => Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .{} for motion of {}",
            path.display(),
            expected.join(", ."),
            if is_weights { "weights" } else { "landmarks" }
        ))),
    }
}

fn is_npz(path: &Path) -> bool {
    matches!(Format::from_path(path), Ok(Format::Npz))
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
