//! Reads vertex motion from files, our own or those of other tools.

use std::path::Path;

use ndarray::Array3;

use super::{Format, numpy::NumpyArchive};
use crate::{
    Error, Result,
    job::{InputKind, read_file},
    mesh::Mesh,
    motion::check_fps,
    nn::finite::check_finite,
};

/// Bytes of the header of a point cache 2 file.
const PC2_HEADER: usize = 32;

/// How far a vertex may move, as a multiple of the size of its mesh.
const FARTHEST: f32 = 50.0;

/// The motion of a mesh, read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexMotion {
    /// `[T, V, 3]`, displacement from the mesh's own positions, mesh units.
    pub displacements: Array3<f32>,
    /// Frames per second, where the file says so.
    pub fps: Option<f64>,
}

/// Reads npz (`displacements` `[T, V, 3]`, `fps`), pc2 or mdd (positions of the same mesh).
///
/// # Errors
/// `Io` if the file cannot be read, `InvalidInput` if it is damaged, of another kind, holds numbers
/// that are not finite or moves vertices too far for the mesh, `ShapeMismatch` if it has another
/// number of vertices than the mesh.
pub fn read_vertex_motion(path: &Path, mesh: &Mesh) -> Result<VertexMotion> {
    let bytes = || read_file(path, InputKind::Arrays);
    let motion = match Format::from_path(path)? {
        Format::Npz => read_npz(path, mesh.positions.len())?,
        Format::Pc2 => pc2(&bytes()?, mesh).map_err(|e| named(path, e))?,
        Format::Mdd => mdd(&bytes()?, mesh).map_err(|e| named(path, e))?,
        Format::Glb | Format::Usda | Format::Vrma => {
            return Err(Error::InvalidInput(format!(
                "{}: expected vertex positions over time (.npz, .pc2 or .mdd), got a scene, which holds shapes and weights",
                path.display()
            )));
        }
    };
    check_finite("animation", motion.displacements.view().into_dyn())
        .map_err(|e| named(path, e))?;
    check_far(&motion.displacements, mesh).map_err(|e| named(path, e))?;
    Ok(motion)
}

/// Refuses displacements many times larger than the mesh: they belong to another mesh or are in
/// another unit.
fn check_far(displacements: &Array3<f32>, mesh: &Mesh) -> Result<()> {
    let mut size = 0.0f32;
    for axis in 0..3 {
        let places = mesh.positions.iter().map(|p| p[axis]);
        let low = places.clone().fold(f32::INFINITY, f32::min);
        size = size.max(places.fold(f32::NEG_INFINITY, f32::max) - low);
    }
    let got = displacements
        .iter()
        .fold(0.0, |most: f32, x| most.max(x.abs()));
    if got <= FARTHEST * size {
        Ok(())
    } else {
        Err(Error::InvalidInput(format!(
            "animation: expected displacements up to {FARTHEST} times the size of the mesh, which is {size}, got {got}; \
             is it of another mesh or in another unit?"
        )))
    }
}

fn named(path: &Path, error: Error) -> Error {
    match error {
        Error::InvalidInput(message) => {
            Error::InvalidInput(format!("{}: {message}", path.display()))
        }
        other => other,
    }
}

fn read_npz(path: &Path, vertices: usize) -> Result<VertexMotion> {
    let mut npz = NumpyArchive::open(path)?;
    let displacements: Array3<f32> = npz.array("displacements")?;
    let (frames, got, axes) = displacements.dim();
    if (got, axes) != (vertices, 3) {
        return Err(mismatch(vertices, &format!("[{frames}, {got}, {axes}]")));
    }
    let fps = if npz.has("fps") {
        Some(npz.number("fps")?)
    } else {
        None
    };
    if let Some(fps) = fps {
        check_fps(fps).map_err(|e| named(path, e))?;
    }
    Ok(VertexMotion { displacements, fps })
}

fn mismatch(vertices: usize, got: &str) -> Error {
    Error::ShapeMismatch {
        what: "animation",
        expected: format!("[T, {vertices}, 3], the mesh's vertices"),
        got: got.into(),
    }
}

fn check(got: usize, vertices: usize) -> Result<()> {
    if got == vertices {
        Ok(())
    } else {
        Err(mismatch(vertices, &format!("[T, {got}, 3]")))
    }
}

fn pc2(bytes: &[u8], mesh: &Mesh) -> Result<VertexMotion> {
    if !bytes.starts_with(b"POINTCACHE2\0") || bytes.len() < PC2_HEADER {
        return Err(Error::InvalidInput(
            "expected a point cache 2 header".into(),
        ));
    }
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    let (vertices, frames) = (number(16) as usize, number(28) as usize);
    check(vertices, mesh.positions.len())?;
    Ok(VertexMotion {
        displacements: moved(&bytes[PC2_HEADER..], frames, mesh, f32::from_le_bytes)?,
        fps: None,
    })
}

fn mdd(bytes: &[u8], mesh: &Mesh) -> Result<VertexMotion> {
    let number = |at: usize| {
        let four = bytes
            .get(at..at + 4)
            .map(|b| b.try_into().expect("four bytes"));
        four.ok_or_else(|| {
            Error::InvalidInput("expected an MDD header, got a file that ends within it".into())
        })
    };
    let frames = u32::from_be_bytes(number(0)?) as usize;
    check(
        u32::from_be_bytes(number(4)?) as usize,
        mesh.positions.len(),
    )?;
    let fps = match frames {
        0 | 1 => None,
        _ => Some(f64::from(
            f32::from_be_bytes(number(12)?) - f32::from_be_bytes(number(8)?),
        )),
    };
    let start = frames.checked_mul(4).and_then(|n| n.checked_add(8));
    let positions = start
        .and_then(|start| bytes.get(start..))
        .unwrap_or_default();
    Ok(VertexMotion {
        displacements: moved(positions, frames, mesh, f32::from_be_bytes)?,
        fps: fps.filter(|step| *step > 0.0).map(|step| 1.0 / step),
    })
}

/// Converts the positions of all frames to displacements.
fn moved(
    bytes: &[u8],
    frames: usize,
    mesh: &Mesh,
    decode: fn([u8; 4]) -> f32,
) -> Result<Array3<f32>> {
    let vertices = mesh.positions.len();
    let expected = frames.checked_mul(vertices).and_then(|n| n.checked_mul(12));
    if expected.is_none_or(|expected| bytes.len() < expected) {
        return Err(Error::InvalidInput(format!(
            "expected positions of {frames} frames of {vertices} vertices, got {} bytes",
            bytes.len()
        )));
    }
    let (fours, _) = bytes.as_chunks::<4>();
    Ok(Array3::from_shape_fn((frames, vertices, 3), |(t, v, i)| {
        decode(fours[(t * vertices + v) * 3 + i]) - mesh.positions[v][i]
    }))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::{deform::VertexClip, output::write_animation, spread::Animation};

    fn mesh() -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]],
            triangles: vec![[0, 1, 2]],
        }
    }

    fn clip() -> Animation {
        Animation {
            vertices: VertexClip {
                displacements: Array3::from_shape_fn((4, 3, 3), |(t, v, i)| {
                    0.25 * (t + v) as f32 - i as f32
                }),
                fps: 25.0,
            },
            landmarks_neutral: [[0.0; 3]; 68],
            landmark_displacements: Array3::zeros((4, 68, 3)),
        }
    }

    #[test]
    fn motion_that_goes_far_beyond_its_mesh_is_refused() {
        let mut displacements = Array3::zeros((2, 1, 3));
        let line = Mesh {
            positions: vec![[0.0; 3], [0.1, 0.0, 0.0]],
            ..Mesh::default()
        };
        displacements[[1, 0, 2]] = 4.0;
        assert!(check_far(&displacements, &line).is_ok());
        displacements[[1, 0, 2]] = 1e6;
        let error = check_far(&displacements, &line).unwrap_err();
        assert!(error.to_string().contains("another unit"), "{error}");
    }

    #[test]
    fn every_format_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        for (name, fps) in [
            ("a.npz", Some(25.0)),
            ("a.pc2", None),
            ("a.mdd", Some(25.0)),
        ] {
            let path = folder.path().join(name);
            write_animation(&path, &clip(), None, &mesh()).unwrap();
            let read = read_vertex_motion(&path, &mesh()).unwrap();
            assert_eq!(read.displacements, clip().vertices.displacements, "{name}");
            match (read.fps, fps) {
                (Some(got), Some(want)) => assert!((got - want).abs() < 1e-3f64, "{name}: {got}"),
                (got, want) => assert_eq!(got, want, "{name}"),
            }
        }
    }

    #[test]
    fn another_mesh_and_damaged_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut larger = mesh();
        larger.positions.push([2.0; 3]);
        for name in ["a.npz", "a.pc2", "a.mdd"] {
            let path = folder.path().join(name);
            write_animation(&path, &clip(), None, &mesh()).unwrap();
            let error = read_vertex_motion(&path, &larger).unwrap_err();
            assert!(
                matches!(error, Error::ShapeMismatch { .. }),
                "{name}: {error}"
            );
            let bytes = fs::read(&path).unwrap();
            fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
            let error = read_vertex_motion(&path, &mesh()).unwrap_err();
            assert!(matches!(error, Error::InvalidInput(_)), "{name}: {error}");
        }
    }
}
