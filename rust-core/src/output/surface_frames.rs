//! Writes a moving surface as a folder with one binary PLY per frame.

use std::{
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use glam::Vec3;
use ndarray::ArrayView2;

use crate::job::UnfinishedFolder;
use crate::{
    Error, Result,
    head::HeadSurface,
    job::{ProgressFn, report},
};

/// Minimum number of digits in a frame's file name.
const DIGITS: usize = 4;

/// Checks that a new folder can be made at `path`: there is nothing yet, or an empty folder.
///
/// # Errors
/// `InvalidInput` for a file, and for a folder that is not empty, because its contents must not mix
/// with frames; `Io` if the folder cannot be read.
pub fn check_new_folder(path: &Path) -> Result<()> {
    let wrong = |got: String| {
        let path = path.display();
        Err(Error::InvalidInput(format!(
            "{path}: expected a new or an empty folder for the frames, got {got}"
        )))
    };
    if !path.exists() {
        return Ok(());
    }
    if !path.is_dir() {
        return wrong("a file".to_owned());
    }
    let mut inside = fs::read_dir(path).map_err(Error::io(path))?;
    match inside.next() {
        None => Ok(()),
        Some(first) => {
            let first = first.map_err(Error::io(path))?.file_name();
            wrong(format!(
                "one with {} files, such as {}",
                1 + inside.count(),
                first.to_string_lossy()
            ))
        }
    }
}

/// Writes the surface under codes `[T, X]` into a new folder, with the first frame in `0001.ply`, in
/// the units and axes of the surface.
///
/// The folder appears once the last frame is written. Returns the largest displacement of any vertex
/// from rest.
///
/// # Errors
/// Those of [`check_new_folder`]; `InvalidInput` for codes of another head; `Io` if a file cannot be written;
/// `Cancelled`.
pub fn write_surface_frames(
    folder: &Path,
    surface: &HeadSurface,
    codes: ArrayView2<'_, f32>,
    progress: ProgressFn<'_>,
) -> Result<f32> {
    check_new_folder(folder)?;
    let folder = without_end(folder);
    let rest = surface.at_rest()?;
    let head = header(rest.len(), surface.triangles().len());
    let faces = faces(surface.triangles());
    let digits = codes.nrows().to_string().len().max(DIGITS);
    let unfinished = UnfinishedFolder::create(&folder)?;
    let mut most = 0.0f32;
    for (t, code) in codes.rows().into_iter().enumerate() {
        report(progress, "frames", t as f32 / codes.nrows() as f32)?;
        let posed = surface.at(&code.to_vec())?;
        most = posed.iter().zip(&rest).map(squared).fold(most, f32::max);
        let path = unfinished.place().join(format!("{:0digits$}.ply", t + 1));
        write(&path, &head, &posed, &faces).map_err(Error::io(&folder))?;
    }
    report(progress, "frames", 1.0)?;
    unfinished.finish()?;
    Ok(most.sqrt())
}

/// A path without a separator at its end. Follows links if the path exists.
fn without_end(path: &Path) -> PathBuf {
    path.canonicalize()
        .unwrap_or_else(|_| path.components().collect())
}

fn squared((a, b): (&[f32; 3], &[f32; 3])) -> f32 {
    Vec3::from(*a).distance_squared((*b).into())
}

fn header(vertices: usize, triangles: usize) -> String {
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment a frame of a head's surface by Anyface\n\
         element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {triangles}\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

fn faces(triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(13 * triangles.len());
    for triangle in triangles {
        bytes.push(3);
        triangle.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    bytes
}

fn write(path: &Path, header: &str, vertices: &[[f32; 3]], faces: &[u8]) -> io::Result<()> {
    let mut file = BufWriter::new(fs::File::create(path)?);
    file.write_all(header.as_bytes())?;
    for x in vertices.as_flattened() {
        file.write_all(&x.to_le_bytes())?;
    }
    file.write_all(faces)?;
    file.flush()
}
