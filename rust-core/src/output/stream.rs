//! Frames into a file as they are made.

use std::{
    io::{Seek, Write},
    path::Path,
};

use ndarray::ArrayView3;

use super::{Format, atomic::atomically, cache::write_positions, mdd, npz::Archive, pc2};
use crate::{Error, Result, mesh::Mesh, motion::LANDMARKS};

/// Size and rate of a clip that is about to be written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipShape {
    /// Number of frames `T`.
    pub frames: usize,
    /// Number of vertices `V`.
    pub vertices: usize,
    /// Frames per second.
    pub fps: f64,
}

/// The landmarks' part of a clip, mesh units.
#[derive(Debug, Clone, Copy)]
pub struct LandmarkTrack<'a> {
    /// `[68][3]`.
    pub neutral: &'a [[f32; 3]; LANDMARKS],
    /// `[T, 68, 3]`.
    pub displacements: ArrayView3<'a, f32>,
}

/// Takes the next frames, `[t, V, 3]` displacements in mesh units.
pub type FrameSink<'a> = &'a mut dyn FnMut(ArrayView3<'_, f32>) -> Result<()>;

/// Writes a clip whose frames `produce` hands over block by block.
///
/// npz: `displacements` `[T, V, 3]`, `landmarks_neutral` `[68, 3]`, `landmark_displacements`
/// `[T, 68, 3]` as f32 in mesh units, and `fps`. pc2 and mdd: positions, mesh units and axes.
///
/// # Errors
/// `InvalidInput` for an unknown extension; `ShapeMismatch` if the mesh or the frames are not of
/// `shape`; `Io` if the file cannot be written; whatever `produce` returns. Then nothing is left.
pub fn write_frames(
    path: &Path,
    shape: &ClipShape,
    mesh: &Mesh,
    landmarks: &LandmarkTrack<'_>,
    produce: impl FnOnce(FrameSink<'_>) -> Result<()>,
) -> Result<()> {
    let format = Format::from_path(path)?;
    if shape.vertices != mesh.positions.len() {
        return Err(mismatch(
            shape.frames,
            mesh.positions.len(),
            shape.frames,
            shape.vertices,
        ));
    }
    atomically(path, |file| {
        write_to(path, file, format, shape, mesh, landmarks, produce)
    })
}

/// The same into any file, for tests of full disks.
pub(super) fn write_to(
    path: &Path,
    mut file: impl Write + Seek,
    format: Format,
    shape: &ClipShape,
    mesh: &Mesh,
    landmarks: &LandmarkTrack<'_>,
    produce: impl FnOnce(FrameSink<'_>) -> Result<()>,
) -> Result<()> {
    let io = || Error::io(path);
    match format {
        Format::Npz => {
            let mut archive = Archive::new(file);
            let sizes = [shape.frames, shape.vertices, 3];
            archive
                .start("displacements", "<f4", &sizes)
                .map_err(io())?;
            counted(shape, produce, |block| archive.values(block).map_err(io()))?;
            archive.neutral(landmarks.neutral).map_err(io())?;
            archive.landmarks(landmarks.displacements).map_err(io())?;
            archive.number("fps", shape.fps).map_err(io())?;
            archive.finish().map_err(io())
        }
        Format::Pc2 => {
            pc2::write_header(&mut file, shape).map_err(io())?;
            counted(shape, produce, |block| {
                write_positions(&mut file, block, mesh, f32::to_le_bytes).map_err(io())
            })
        }
        Format::Mdd => {
            mdd::write_header(&mut file, shape).map_err(io())?;
            counted(shape, produce, |block| {
                write_positions(&mut file, block, mesh, f32::to_be_bytes).map_err(io())
            })
        }
    }
}

/// Runs `produce` and holds it to the shape that the header has announced.
fn counted(
    shape: &ClipShape,
    produce: impl FnOnce(FrameSink<'_>) -> Result<()>,
    mut write: impl FnMut(ArrayView3<'_, f32>) -> Result<()>,
) -> Result<()> {
    let mut taken = 0;
    produce(&mut |block| {
        let (frames, vertices, axes) = block.dim();
        taken += frames;
        if vertices != shape.vertices || axes != 3 || taken > shape.frames {
            return Err(mismatch(shape.frames, shape.vertices, taken, vertices));
        }
        write(block)
    })?;
    match taken == shape.frames {
        true => Ok(()),
        false => Err(mismatch(
            shape.frames,
            shape.vertices,
            taken,
            shape.vertices,
        )),
    }
}

fn mismatch(frames: usize, vertices: usize, got_frames: usize, got_vertices: usize) -> Error {
    Error::ShapeMismatch {
        what: "displacements",
        expected: format!("[{frames}, {vertices}, 3]"),
        got: format!("[{got_frames}, {got_vertices}, 3]"),
    }
}
