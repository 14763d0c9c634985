//! Keeps numbers in a temporary file until they can be written after others.

use std::{
    fs::File,
    io::{self, BufWriter, Read, Seek, SeekFrom, Write},
    ops::Range,
    path::{Path, PathBuf},
};

use ndarray::ArrayViewD;

use crate::{Error, Result};

/// Number of values that are converted to bytes at a time.
const BATCH: usize = 1 << 16;

/// Rows of a growing array, in an unnamed temporary file that disappears with the process.
pub(super) struct Rows {
    /// The path of the final file, for error messages.
    path: PathBuf,
    file: BufWriter<File>,
    shape: Vec<usize>,
}

impl Rows {
    /// No rows yet. The temporary file lies in the folder of `path`, which must have room for the
    /// result anyway.
    ///
    /// # Errors
    /// `Io` if the folder cannot be written to.
    pub(super) fn beside(path: &Path) -> Result<Rows> {
        let folder = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        let file =
            tempfile::tempfile_in(folder.unwrap_or(Path::new("."))).map_err(Error::io(path))?;
        Ok(Rows {
            path: path.to_owned(),
            file: BufWriter::new(file),
            shape: vec![0],
        })
    }

    /// Adds rows `[t, …]`, all of the same shape.
    ///
    /// # Errors
    /// `Io` if they cannot be written.
    pub(super) fn add(&mut self, rows: ArrayViewD<'_, f32>) -> Result<()> {
        let before = self.shape[0];
        self.shape = rows.shape().to_vec();
        self.shape[0] += before;
        write_values(&mut self.file, rows).map_err(Error::io(&self.path))
    }

    /// Reads some of the rows, `[n, …]` with the last axis fastest.
    ///
    /// # Errors
    /// `Io` if they cannot be read.
    pub(super) fn read(&mut self, rows: Range<usize>) -> Result<Vec<f32>> {
        let width: usize = self.shape[1..].iter().product();
        let mut bytes = vec![0; 4 * width * rows.len()];
        let start = SeekFrom::Start(4 * (width * rows.start) as u64);
        let file = &mut self.file;
        let read = file
            .seek(start)
            .and_then(|_| file.get_mut().read_exact(&mut bytes))
            .and_then(|()| file.seek(SeekFrom::End(0)));
        read.map_err(Error::io(&self.path))?;
        let (items, _) = bytes.as_chunks();
        Ok(items.iter().map(|item| f32::from_le_bytes(*item)).collect())
    }

    /// Shape of the array so far, `[T, …]`.
    pub(super) fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Copies all rows to a writer.
    ///
    /// # Errors
    /// Those of either file.
    pub(super) fn copy_to(self, to: &mut impl Write) -> io::Result<()> {
        let mut file = self.file.into_inner()?;
        file.seek(SeekFrom::Start(0))?;
        io::copy(&mut file, to).map(drop)
    }
}

/// Writes values as `<f4`, with the last axis fastest.
pub(super) fn write_values(to: &mut impl Write, values: ArrayViewD<'_, f32>) -> io::Result<()> {
    let values = values.as_standard_layout();
    let mut batch = vec![0; BATCH * 4];
    for values in values.as_slice().expect("standard layout").chunks(BATCH) {
        let batch = &mut batch[..4 * values.len()];
        let (items, _) = batch.as_chunks_mut();
        let pairs = items.iter_mut().zip(values);
        pairs.for_each(|(item, value)| *item = value.to_le_bytes());
        to.write_all(batch)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn rows_come_back_in_their_order() {
        let folder = tempfile::tempdir().unwrap();
        let all = Array3::from_shape_fn((5, 2, 3), |(t, n, i)| (6 * t + 3 * n + i) as f32);
        let mut rows = Rows::beside(&folder.path().join("clip.npz")).unwrap();
        for (from, to) in [(0, 2), (2, 2), (2, 5)] {
            rows.read(0..rows.shape()[0].min(1)).unwrap();
            rows.add(all.slice(ndarray::s![from..to, .., ..]).into_dyn())
                .unwrap();
        }
        assert_eq!(rows.shape(), [5, 2, 3]);
        let middle: Vec<f32> = (6..18u8).map(f32::from).collect();
        assert_eq!(rows.read(1..3).unwrap(), middle);
        let mut bytes = Vec::new();
        rows.copy_to(&mut bytes).unwrap();
        let (items, rest) = bytes.as_chunks::<4>();
        let values: Vec<f32> = items.iter().map(|item| f32::from_le_bytes(*item)).collect();
        assert_eq!(
            (values, rest.len()),
            ((0..30u8).map(f32::from).collect(), 0)
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
