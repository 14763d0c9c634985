//! Writes motion into a file while it is being made.

use std::{
    fs::File,
    io::BufWriter,
    path::{Path, PathBuf},
};

use ndarray::aview1;

use super::{Format, blend_weights::write_blend_weights, npz::Archive, rows::Rows};
use crate::{
    Error, Result,
    job::Unfinished,
    mesh::ibug::LANDMARKS,
    motion::{LandmarkClip, Life, Motion, WeightClip},
    rig::SolvedWeights,
};

/// A file that takes motion part by part. The file appears once it is complete.
///
/// An npz has `landmark_displacements` `[T, 68, 3]` in canonical metres, `fps`, and `head`, `gaze`
/// and `tongue` as in [`Life`]. For motion of weights it also has the `weights` `[T, S]`, their
/// `names` `[S]`, and `together` `[T]`: how far the lips have to meet on any head that shows it.
/// Motion of weights may also go to a .csv or .json, which then holds the weights alone, as
/// [`write_blend_weights`] writes them.
pub struct MotionFile {
    path: PathBuf,
    fps: f64,
    life: Option<Life>,
    body: Body,
}

enum Body {
    Npz(Box<Open>),
    /// A .csv or .json, which holds weights alone.
    Table(Option<WeightClip>),
}

/// An archive that is receiving its landmarks.
struct Open {
    unfinished: Unfinished,
    archive: Archive<BufWriter<File>>,
    weights: Option<Waiting>,
}

/// Weights, which wait because they follow all landmarks in the archive.
struct Waiting {
    names: Vec<String>,
    weights: Rows,
    together: Rows,
}

impl MotionFile {
    /// A file for this many `frames`. `is_weights`: whether the motion is weights.
    ///
    /// # Errors
    /// Those of [`check_motion_path`]; `Io` if the file cannot be written.
    pub fn new(path: &Path, is_weights: bool, frames: usize, fps: f64) -> Result<MotionFile> {
        check_motion_path(path, is_weights)?;
        let body = match Format::from_path(path) {
            Ok(Format::Npz) => {
                let (unfinished, file) = Unfinished::create(path)?;
                let mut archive = Archive::new(file);
                let sizes = [frames, LANDMARKS, 3];
                archive
                    .start("landmark_displacements", "<f4", &sizes)
                    .map_err(Error::io(path))?;
                Body::Npz(Box::new(Open {
                    unfinished,
                    archive,
                    weights: None,
                }))
            }
            _ => Body::Table(None),
        };
        Ok(MotionFile {
            path: path.to_owned(),
            fps,
            life: None,
            body,
        })
    }

    /// Adds the next part of the motion, its landmarks on the mean face ([`Motion::on_mean_face`]),
    /// and its head, eyes and tongue.
    ///
    /// # Errors
    /// `Io` if the file cannot be written.
    pub fn add(
        &mut self,
        motion: &Motion,
        landmarks: &LandmarkClip,
        life: Option<&Life>,
    ) -> Result<()> {
        let weights = match motion {
            Motion::Weights(clip) => Some(clip),
            Motion::Landmarks(_) | Motion::Codes(_) => None,
        };
        match (&mut self.life, life) {
            (Some(before), Some(life)) => before.append(life),
            (before, life) => *before = life.cloned(),
        }
        match &mut self.body {
            Body::Npz(open) => {
                let written = open.archive.values(landmarks.displacements.view());
                written.map_err(Error::io(&self.path))?;
                if let Some(clip) = weights {
                    if open.weights.is_none() {
                        open.weights = Some(Waiting {
                            names: clip.names.clone(),
                            weights: Rows::beside(&self.path)?,
                            together: Rows::beside(&self.path)?,
                        });
                    }
                    if let Some(waiting) = &mut open.weights {
                        waiting.weights.add(clip.weights.view().into_dyn())?;
                        let together = aview1(&clip.together);
                        waiting.together.add(together.into_dyn())?;
                    }
                }
                Ok(())
            }
            Body::Table(before) => {
                match (before, weights) {
                    (Some(before), Some(clip)) => before.append(clip),
                    (before, clip) => *before = clip.cloned(),
                }
                Ok(())
            }
        }
    }

    /// Writes the rest of the file and gives it its name.
    ///
    /// # Errors
    /// `Io` if it cannot be written.
    pub fn finish(self) -> Result<()> {
        match self.body {
            Body::Npz(open) => {
                let Open {
                    unfinished,
                    mut archive,
                    weights,
                } = *open;
                let end = || {
                    if let Some(waiting) = weights {
                        archive.names(&waiting.names)?;
                        archive.rows("weights", waiting.weights)?;
                        archive.rows("together", waiting.together)?;
                    }
                    self.life
                        .as_ref()
                        .map_or(Ok(()), |life| archive.life(life))?;
                    archive.number("fps", self.fps)?;
                    archive.finish()
                };
                end().map_err(Error::io(&self.path))?;
                unfinished.finish()
            }
            Body::Table(clip) => {
                let Some(clip) = clip else {
                    return Ok(());
                };
                let weights = SolvedWeights::exact(clip.names, clip.weights);
                write_blend_weights(&self.path, &weights, self.fps)
            }
        }
    }
}

/// Checks that motion can be written under this name: .npz, or for weights also .csv or .json.
///
/// # Errors
/// `InvalidInput` for another extension.
pub fn check_motion_path(path: &Path, is_weights: bool) -> Result<()> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let expected = if is_weights {
        &["npz", "csv", "json"][..]
    } else {
        &["npz"]
    };
    if expected.contains(&ending.to_ascii_lowercase().as_str()) {
        Ok(())
    } else {
        Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .{} for motion of {}",
            path.display(),
            expected.join(", ."),
            if is_weights { "weights" } else { "landmarks" }
        )))
    }
}
