//! Reads motion from numpy archives, which Anyface or numpy wrote.

use std::path::Path;

use ndarray::{Array1, Array2, Array3, ArrayViewD};

use super::numpy::NumpyArchive;
use crate::{
    Error, Result,
    mesh::ibug::LANDMARKS,
    motion::{
        Life, WeightClip,
        bounds::{DISPLACEMENT, WEIGHT, check_life},
        check_fps,
    },
    speech::TONGUE_PLACES,
};

/// Landmark motion as a file holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkMotion {
    /// `[68][3]`, mesh units; `None` in files that hold canonical metres.
    pub neutral: Option<[[f32; 3]; LANDMARKS]>,
    /// `[T, 68, 3]`, mesh units where `neutral` is given, canonical metres where it is not.
    pub displacements: Array3<f32>,
    /// Frames per second, if the file has them.
    pub fps: Option<f64>,
}

/// Reads `landmark_displacements`, and if the file has them `landmarks_neutral` and `fps`.
///
/// Arrays may hold f32, f64 or integers. `fps` may be a single number or an array of one.
///
/// # Errors
/// `Io` if the file cannot be read; `InvalidInput` if it is no npz, lacks the displacements, or
/// holds numbers that are not finite or displacements in metres beyond [`DISPLACEMENT`];
/// `ShapeMismatch` for wrong shapes.
pub fn read_landmark_motion(path: &Path) -> Result<LandmarkMotion> {
    let mut npz = NumpyArchive::open(path)?;
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let displacements: Array3<f32> = npz.array("landmark_displacements")?;
    let (frames, landmarks, axes) = displacements.dim();
    if (landmarks, axes) != (LANDMARKS, 3) {
        return Err(Error::ShapeMismatch {
            what: "landmark_displacements",
            expected: format!("[{frames}, {LANDMARKS}, 3]"),
            got: format!("[{frames}, {landmarks}, {axes}]"),
        });
    }
    let neutral = if npz.has("landmarks_neutral") {
        Some(neutral_of(&npz.array("landmarks_neutral")?)?)
    } else {
        None
    };
    let fps = if npz.has("fps") {
        Some(npz.number("fps")?)
    } else {
        None
    };
    check_finite(displacements.view().into_dyn(), fps).map_err(|e| bad(&e))?;
    if neutral.is_none() {
        // Displacements in mesh units are checked later, once the size of the mesh is known.
        DISPLACEMENT.check(&displacements).map_err(|e| bad(&e))?;
    }
    Ok(LandmarkMotion {
        neutral,
        displacements,
        fps,
    })
}

/// Reads `head` `[T, 3]`, `gaze` `[T, 2, 2]` and `tongue` `[T, 4]`.
///
/// Returns `None` if the file lacks `head` or `gaze`. If it lacks `tongue`, the tongue rests.
///
/// # Errors
/// `Io` if the file cannot be read; `InvalidInput` if it is no npz, or holds numbers that are not
/// finite or out of range; `ShapeMismatch` for other shapes.
pub fn read_life(path: &Path) -> Result<Option<Life>> {
    let mut npz = NumpyArchive::open(path)?;
    if !npz.has("head") || !npz.has("gaze") {
        return Ok(None);
    }
    let head: Array2<f32> = npz.array("head")?;
    let gaze: Array3<f32> = npz.array("gaze")?;
    let frames = head.nrows();
    let tongue: Array2<f32> = if npz.has("tongue") {
        npz.array("tongue")?
    } else {
        Life::still(frames).tongue
    };
    let sizes = (head.ncols(), gaze.dim(), tongue.dim());
    if sizes != (3, (frames, 2, 2), (frames, TONGUE_PLACES)) {
        return Err(Error::ShapeMismatch {
            what: "head, gaze and tongue",
            expected: format!("[{frames}, 3], [{frames}, 2, 2] and [{frames}, {TONGUE_PLACES}]"),
            got: format!(
                "{:?}, {:?} and {:?}",
                head.shape(),
                gaze.shape(),
                tongue.shape()
            ),
        });
    }
    let values = head.iter().chain(&gaze).chain(&tongue);
    if values.into_iter().any(|x| !x.is_finite()) {
        return Err(Error::InvalidInput(format!(
            "{}: head, gaze and tongue: expected finite numbers, got NaN or infinity",
            path.display()
        )));
    }
    let life = Life { head, gaze, tongue };
    check_life(&life).map_err(|e| Error::InvalidInput(format!("{}: {e}", path.display())))?;
    Ok(Some(life))
}

/// Reads motion of weights: `weights` `[T, S]`, `names` `[S]`, `fps` and `together` `[T]` or `[0]`.
///
/// Returns `None` if the file has no `weights`.
///
/// # Errors
/// `Io` if the file cannot be read; `InvalidInput` if it is no npz, lacks one of the others, or
/// holds numbers that are not finite or out of range; `ShapeMismatch` if their lengths do not match.
pub fn read_weights(path: &Path) -> Result<Option<WeightClip>> {
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let mut npz = NumpyArchive::open(path)?;
    if !npz.has("weights") {
        return Ok(None);
    }
    let weights: Array2<f32> = npz.array("weights")?;
    let fps = npz.number("fps")?;
    let names = npz.texts("names")?;
    if names.len() != weights.ncols() {
        return Err(Error::ShapeMismatch {
            what: "weights",
            expected: format!("[T, {}], one column a name", names.len()),
            got: format!("{:?}", weights.shape()),
        });
    }
    let together: Array1<f32> = npz.array("together")?;
    if ![0, weights.nrows()].contains(&together.len()) {
        return Err(Error::ShapeMismatch {
            what: "together",
            expected: format!("[{}], one number a frame, or none", weights.nrows()),
            got: format!("{:?}", together.shape()),
        });
    }
    if weights.iter().chain(&together).any(|x| !x.is_finite()) {
        return Err(bad(
            &"weights: expected finite numbers, got NaN or infinity",
        ));
    }
    check_fps(fps).map_err(|e| bad(&e))?;
    WEIGHT.check(&weights).map_err(|e| bad(&e))?;
    Ok(Some(WeightClip {
        names,
        weights,
        fps,
        together: together.to_vec(),
    }))
}

fn neutral_of(array: &Array2<f32>) -> Result<[[f32; 3]; LANDMARKS]> {
    if array.dim() != (LANDMARKS, 3) {
        return Err(Error::ShapeMismatch {
            what: "landmarks_neutral",
            expected: format!("[{LANDMARKS}, 3]"),
            got: format!("{:?}", array.shape()),
        });
    }
    if array.iter().any(|x| !x.is_finite()) {
        return Err(Error::InvalidInput(
            "landmarks_neutral: expected finite numbers, got NaN or infinity".into(),
        ));
    }
    Ok(std::array::from_fn(|n| {
        std::array::from_fn(|i| array[[n, i]])
    }))
}

fn check_finite(displacements: ArrayViewD<'_, f32>, fps: Option<f64>) -> Result<(), String> {
    if let Some(at) = displacements.iter().position(|x| !x.is_finite()) {
        let frame = at / (LANDMARKS * 3);
        return Err(format!(
            "landmark_displacements: expected finite numbers, got NaN or infinity in frame {frame}"
        ));
    }
    match fps {
        Some(fps) => check_fps(fps).map_err(|error| error.to_string()),
        None => Ok(()),
    }
}
