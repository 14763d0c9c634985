//! Motion into a file as it is made.

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

/// A file that takes motion part by part; it is there when the last one was taken, and never half.
///
/// npz: `landmark_displacements` `[T, 68, 3]` in canonical metres, `fps`, and `head`, `gaze` and `tongue` as [`Life`] has
/// them. Motion of weights has its `weights` `[T, S]`, their `names` `[S]` and `together` `[T]` too, how far lips have to
/// meet on whatever head shows it; it may go to a .csv or .json as well, as [`write_blend_weights`] writes them, alone.
pub struct MotionFile {
    path: PathBuf,
    fps: f64,
    life: Option<Life>,
    body: Body,
}

enum Body {
    Npz(Box<Open>),
    /// What takes weights alone.
    Table(Option<WeightClip>),
}

/// An archive whose landmarks come.
struct Open {
    unfinished: Unfinished,
    archive: Archive<BufWriter<File>>,
    weights: Option<Waiting>,
}

/// Weights, which stand behind all landmarks.
struct Waiting {
    names: Vec<String>,
    weights: Rows,
    together: Rows,
}

impl MotionFile {
    /// A file for so many `frames`, of weights where it `is_weights`.
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

    /// Takes the motion that follows, its landmarks on the mean face ([`Motion::on_mean_face`]) and what stands beside it.
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

    /// Writes what stands behind the motion; the file is there.
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
