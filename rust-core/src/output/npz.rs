//! Writes numpy archives as a stream: uncompressed arrays, with 64-bit sizes where they need them.

use std::io::{self, Seek, SeekFrom, Write};

use ndarray::{ArrayView2, ArrayView3, Axis};
use zip::{CompressionMethod, ZipWriter, result::ZipError, write::SimpleFileOptions};

use super::rows::{Rows, write_values};
use crate::{mesh::ibug::LANDMARKS, motion::Life};

/// The entry of an array with more bytes than this gets 64-bit sizes.
const LARGE_BYTES: u64 = u32::MAX as u64 - 4096;

/// `attention`, `[V, 68]`.
pub(super) fn write_attention(
    file: impl Write + Seek,
    attention: ArrayView2<'_, f32>,
) -> io::Result<()> {
    let mut archive = Archive::new(file);
    archive.start("attention", "<f4", attention.shape())?;
    archive.values(attention.insert_axis(Axis(0)))?;
    archive.finish()
}

/// `mask`, `[T, V]`.
pub(super) fn write_mask(file: impl Write + Seek, mask: ArrayView2<'_, f32>) -> io::Result<()> {
    let mut archive = Archive::new(file);
    archive.start("mask", "<f4", mask.shape())?;
    archive.values(mask.insert_axis(Axis(0)))?;
    archive.finish()
}

/// An archive that is being written.
pub(super) struct Archive<W: Write + Seek> {
    zip: ZipWriter<QuietAfterFailure<W>>,
}

impl<W: Write + Seek> Archive<W> {
    pub(super) fn new(file: W) -> Self {
        Archive {
            zip: ZipWriter::new(QuietAfterFailure {
                file,
                position: 0,
                failed: false,
            }),
        }
    }

    /// Writes an array whose rows have waited in a temporary file.
    pub(super) fn rows(&mut self, name: &str, rows: Rows) -> io::Result<()> {
        self.start(name, "<f4", rows.shape())?;
        rows.copy_to(&mut self.zip)
    }

    /// `landmarks_neutral`, `[68, 3]`.
    pub(super) fn neutral(&mut self, landmarks: &[[f32; 3]; LANDMARKS]) -> io::Result<()> {
        self.start("landmarks_neutral", "<f4", &[LANDMARKS, 3])?;
        let landmarks = ArrayView3::from_shape((1, LANDMARKS, 3), landmarks.as_flattened());
        self.values(landmarks.map_err(io::Error::other)?)
    }

    /// `head`, `[T, 3]`, `gaze`, `[T, 2, 2]`, and `tongue`, `[T, 4]`.
    pub(super) fn life(&mut self, life: &Life) -> io::Result<()> {
        self.start("head", "<f4", life.head.shape())?;
        self.values(life.head.view().insert_axis(Axis(0)))?;
        self.start("gaze", "<f4", life.gaze.shape())?;
        self.values(life.gaze.view())?;
        self.start("tongue", "<f4", life.tongue.shape())?;
        self.values(life.tongue.view().insert_axis(Axis(0)))
    }

    /// A scalar of double precision.
    pub(super) fn number(&mut self, name: &str, value: f64) -> io::Result<()> {
        self.start(name, "<f8", &[])?;
        self.bytes(&value.to_le_bytes())
    }

    /// `names`, `[S]`, as numpy's own Unicode type `<U…`: UTF-32, padded with zeros.
    pub(super) fn names(&mut self, names: &[String]) -> io::Result<()> {
        let length = |name: &String| name.chars().count();
        let longest = names.iter().map(length).max().unwrap_or(0).max(1);
        self.start("names", &format!("<U{longest}"), &[names.len()])?;
        for name in names {
            let padding = std::iter::repeat_n(0, longest - length(name));
            for code in name.chars().map(u32::from).chain(padding) {
                self.bytes(&code.to_le_bytes())?;
            }
        }
        Ok(())
    }

    /// Begins an array. Its values must follow, with the last axis fastest.
    pub(super) fn start(&mut self, name: &str, kind: &str, shape: &[usize]) -> io::Result<()> {
        let bytes = shape.iter().map(|n| *n as u64).product::<u64>() * 8;
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(bytes > LARGE_BYTES);
        self.zip
            .start_file(format!("{name}.npy"), options)
            .map_err(zip_error)?;
        self.bytes(&npy_header(kind, shape))
    }

    /// Appends values to the array that was started last.
    pub(super) fn values(&mut self, values: ArrayView3<'_, f32>) -> io::Result<()> {
        write_values(&mut self.zip, values.into_dyn())
    }

    fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.zip.write_all(bytes)
    }

    pub(super) fn finish(self) -> io::Result<()> {
        self.zip.finish().map_err(zip_error)?.flush()
    }
}

/// A file that reports its first failure and then swallows everything.
///
/// When `ZipWriter` is dropped after a failure, it tries to finish the archive and prints why it
/// cannot. A library must not print.
struct QuietAfterFailure<W> {
    file: W,
    position: u64,
    failed: bool,
}

impl<W: Write> Write for QuietAfterFailure<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = if self.failed {
            bytes.len()
        } else {
            self.file.write(bytes).inspect_err(|_| self.failed = true)?
        };
        self.position += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.failed {
            Ok(())
        } else {
            self.file.flush().inspect_err(|_| self.failed = true)
        }
    }
}

impl<W: Seek> Seek for QuietAfterFailure<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.position = match (self.failed, to) {
            (false, to) => self.file.seek(to).inspect_err(|_| self.failed = true)?,
            (true, SeekFrom::Start(position)) => position,
            (true, SeekFrom::Current(step)) => self.position.saturating_add_signed(step),
            (true, SeekFrom::End(_)) => self.position,
        };
        Ok(self.position)
    }
}

/// Header of version 1.0, padded so that the values start at a multiple of 64 bytes.
fn npy_header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let sizes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let dict = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sizes}), }}");
    let length = (10 + dict.len() + 1).next_multiple_of(64) - 10;
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend_from_slice(&(length as u16).to_le_bytes());
    header.extend_from_slice(format!("{dict:<width$}\n", width = length - 1).as_bytes());
    header
}

/// Keeps the error of the system, so that a full disk is reported as such.
fn zip_error(e: ZipError) -> io::Error {
    match e {
        ZipError::Io(e) => e,
        e => io::Error::other(e.to_string()),
    }
}
