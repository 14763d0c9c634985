//! The bytes of a sound: a file, or what came through a pipe.

use std::{
    fs::File,
    io::{self, Cursor, Read, Seek, SeekFrom},
    path::Path,
    sync::Arc,
};

use symphonia::core::io::MediaSource;

use crate::{Error, Result};

/// Most bytes that are taken from a pipe or a device: an hour and a half of stereo WAV at 48 kHz.
const LARGEST_PIPE: u64 = 1 << 30;

/// Can be read several times from its start.
#[derive(Clone)]
pub(super) enum Source {
    File(Arc<Path>),
    Memory(Arc<[u8]>),
}

/// One reading.
pub(super) enum Reading {
    File(File),
    Memory(Cursor<Arc<[u8]>>),
}

impl Source {
    /// A pipe can be read but once, so that its bytes are kept.
    ///
    /// # Errors
    /// `Io` if it cannot be read, `Audio` if it is empty or a pipe without an end.
    pub(super) fn open(path: &Path) -> Result<Source> {
        let file = File::open(path).map_err(Error::io(path))?;
        let known = file.metadata().map_err(Error::io(path))?;
        if known.is_dir() {
            return Err(Error::io(path)(io::ErrorKind::IsADirectory.into()));
        }
        let (source, length) = match known.is_file() {
            true => (Source::File(path.into()), known.len()),
            false => {
                let mut bytes = Vec::new();
                let read = file.take(LARGEST_PIPE + 1).read_to_end(&mut bytes);
                read.map_err(Error::io(path))?;
                let length = bytes.len() as u64;
                (Source::Memory(bytes.into()), length)
            }
        };
        let refuse = |what: &str| Error::Audio(format!("{}: {what}", path.display()));
        match (length, &source) {
            (0, _) => Err(refuse("the file is empty")),
            (LARGEST_PIPE.., Source::Memory(_)) => Err(refuse(&format!(
                "expected at most {LARGEST_PIPE} bytes through a pipe, got more"
            ))),
            _ => Ok(source),
        }
    }

    /// Reads it from the start.
    ///
    /// # Errors
    /// `Io` if the file is no longer there.
    pub(super) fn read(&self) -> Result<Reading> {
        Ok(match self {
            Source::File(path) => Reading::File(File::open(path).map_err(Error::io(&**path))?),
            Source::Memory(bytes) => Reading::Memory(Cursor::new(Arc::clone(bytes))),
        })
    }
}

impl Read for Reading {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Reading::File(file) => file.read(into),
            Reading::Memory(bytes) => bytes.read(into),
        }
    }
}

impl Seek for Reading {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Reading::File(file) => file.seek(to),
            Reading::Memory(bytes) => bytes.seek(to),
        }
    }
}

impl MediaSource for Reading {
    fn is_seekable(&self) -> bool {
        true
    }

    fn byte_len(&self) -> Option<u64> {
        match self {
            Reading::File(file) => file.metadata().ok().map(|known| known.len()),
            Reading::Memory(bytes) => Some(bytes.get_ref().len() as u64),
        }
    }
}
