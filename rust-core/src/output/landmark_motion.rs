//! Landmark motion back from numpy archives, of ours or of numpy's making.

use std::{fs::File, io::BufReader, path::Path};

use ndarray::{Array1, Array2, Array3, ArrayViewD, IxDyn};
use ndarray_npy::{NpzReader, ReadNpzError};

use super::rig::read_names;
use crate::{
    Error, Result,
    conditions::check_fps,
    ibug::LANDMARKS,
    motion::{Life, WeightClip},
};

/// Landmark motion as a file holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkMotion {
    /// `[68][3]`, mesh units; `None` in files that hold canonical metres.
    pub neutral: Option<[[f32; 3]; LANDMARKS]>,
    /// `[T, 68, 3]`, mesh units where `neutral` is given, canonical metres where it is not.
    pub displacements: Array3<f32>,
    /// Frames per second, where the file says so.
    pub fps: Option<f64>,
}

/// Reads `landmark_displacements`, and `landmarks_neutral` and `fps` where they are there.
///
/// Arrays may be f32 or f64; `fps` may be any number, alone or in an array of one.
///
/// # Errors
/// `Io` if the file cannot be read, `InvalidInput` if it is no npz, lacks the displacements or
/// holds numbers that are not finite, `ShapeMismatch` for wrong shapes.
pub fn read_landmark_motion(path: &Path) -> Result<LandmarkMotion> {
    let file = File::open(path).map_err(Error::io(path))?;
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let mut npz = NpzReader::new(BufReader::new(file))
        .map_err(|e| bad(&format!("expected an npz archive ({e})")))?;
    let names = npz.names().map_err(|e| bad(&e))?;
    let has = |name: &str| names.iter().any(|n| n == name);
    if !has("landmark_displacements") {
        return Err(bad(&format!(
            "expected an array landmark_displacements, got {}",
            names.join(", ")
        )));
    }
    let displacements: Array3<f32> =
        read(&mut npz, "landmark_displacements").map_err(|e| bad(&e))?;
    let (frames, landmarks, axes) = displacements.dim();
    if (landmarks, axes) != (LANDMARKS, 3) {
        return Err(Error::ShapeMismatch {
            what: "landmark_displacements",
            expected: format!("[{frames}, {LANDMARKS}, 3]"),
            got: format!("[{frames}, {landmarks}, {axes}]"),
        });
    }
    let neutral = match has("landmarks_neutral") {
        true => Some(neutral_of(
            &read(&mut npz, "landmarks_neutral").map_err(|e| bad(&e))?,
        )?),
        false => None,
    };
    let fps = match has("fps") {
        true => Some(read_number(&mut npz, "fps").map_err(|e| bad(&e))?),
        false => None,
    };
    check_finite(displacements.view().into_dyn(), fps).map_err(|e| bad(&e))?;
    Ok(LandmarkMotion {
        neutral,
        displacements,
        fps,
    })
}

/// Reads `head` `[T, 3]` and `gaze` `[T, 2, 2]`; `None` in files that lack either.
///
/// # Errors
/// `Io` if the file cannot be read, `InvalidInput` if it is no npz, `ShapeMismatch` for other shapes.
pub fn read_life(path: &Path) -> Result<Option<Life>> {
    let file = File::open(path).map_err(Error::io(path))?;
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let mut npz = NpzReader::new(BufReader::new(file)).map_err(|e| bad(&e))?;
    let names = npz.names().map_err(|e| bad(&e))?;
    if !["head", "gaze"]
        .iter()
        .all(|name| names.iter().any(|n| n == name))
    {
        return Ok(None);
    }
    let head: Array2<f32> = read(&mut npz, "head").map_err(|e| bad(&e))?;
    let gaze: Array3<f32> = read(&mut npz, "gaze").map_err(|e| bad(&e))?;
    let frames = head.nrows();
    match (head.ncols(), gaze.dim()) == (3, (frames, 2, 2)) {
        true => Ok(Some(Life { head, gaze })),
        false => Err(Error::ShapeMismatch {
            what: "head and gaze",
            expected: format!("[{frames}, 3] and [{frames}, 2, 2]"),
            got: format!("{:?} and {:?}", head.shape(), gaze.shape()),
        }),
    }
}

/// Reads `weights` `[T, S]`, `names` `[S]`, `fps` and `together` `[T]` (or nothing), as motion of weights is
/// written; `None` in files without weights.
///
/// # Errors
/// `Io` if the file cannot be read, `InvalidInput` if it is no npz, lacks one of these or holds numbers that
/// are not finite, `ShapeMismatch` where they differ in number.
pub fn read_weights(path: &Path) -> Result<Option<WeightClip>> {
    let file = File::open(path).map_err(Error::io(path))?;
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let mut npz = NpzReader::new(BufReader::new(file)).map_err(|e| bad(&e))?;
    let has_weights = npz
        .names()
        .map_err(|e| bad(&e))?
        .iter()
        .any(|n| n == "weights");
    if !has_weights {
        return Ok(None);
    }
    let weights: Array2<f32> = read(&mut npz, "weights").map_err(|e| bad(&e))?;
    let fps = read_number(&mut npz, "fps").map_err(|e| bad(&e))?;
    let names = read_names(path)?;
    if names.len() != weights.ncols() {
        return Err(Error::ShapeMismatch {
            what: "weights",
            expected: format!("[T, {}], one column a name", names.len()),
            got: format!("{:?}", weights.shape()),
        });
    }
    let together: Array1<f32> = read(&mut npz, "together").map_err(|e| bad(&e))?;
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

type Archive = NpzReader<BufReader<File>>;

/// An f32 array, or an f64 one rounded to f32.
fn read<D: ndarray::Dimension>(
    npz: &mut Archive,
    name: &str,
) -> Result<ndarray::Array<f32, D>, ReadNpzError> {
    match npz.by_name::<ndarray::OwnedRepr<f32>, D>(name) {
        Ok(array) => Ok(array),
        Err(first) => npz
            .by_name::<ndarray::OwnedRepr<f64>, D>(name)
            .map(|array| array.mapv(|x| x as f32))
            .map_err(|_| first),
    }
}

fn read_number(npz: &mut Archive, name: &str) -> Result<f64, String> {
    macro_rules! attempt {
        ($($kind:ty),*) => {$(
            if let Ok(array) = npz.by_name::<ndarray::OwnedRepr<$kind>, IxDyn>(name) {
                let values: Vec<f64> = array.iter().map(|x| *x as f64).collect();
                return match values[..] {
                    [value] => Ok(value),
                    _ => Err(format!("{name}: expected one number, got {}", values.len())),
                };
            }
        )*};
    }
    attempt!(f64, f32, i64, i32);
    Err(format!("{name}: expected a number"))
}
