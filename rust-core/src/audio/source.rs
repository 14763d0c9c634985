//! The bytes of a sound, from a file or a pipe.

use std::{
    io::{self, Cursor, Read, Seek, SeekFrom},
    path::Path,
    sync::Arc,
};

use symphonia::core::io::MediaSource;

use crate::{
    Error, Result,
    job::{Input, InputKind},
};

/// Bytes that can be read from the start several times.
#[derive(Clone)]
pub(super) enum Source {
    File(Arc<Path>),
    Memory(Arc<[u8]>),
    /// A stretch of another source behind a header of our own.
    Behind {
        header: Arc<[u8]>,
        inner: Arc<Source>,
        from: u64,
        length: u64,
    },
}

/// One pass through the bytes of a source.
pub(super) enum Reading {
    File(Input),
    Memory(Cursor<Arc<[u8]>>),
    Behind {
        header: Arc<[u8]>,
        inner: Box<Reading>,
        from: u64,
        length: u64,
        at: u64,
    },
}

impl Source {
    /// Opens a file or pipe. A pipe can be read only once, so its bytes are kept in memory.
    ///
    /// # Errors
    /// Those of [`Input::open`]; `Audio` if it is empty.
    pub(super) fn open(path: &Path) -> Result<Source> {
        let input = Input::open(path, InputKind::Sound)?;
        if input.length().map_err(Error::io(path))? == 0 {
            let path = path.display();
            return Err(Error::Audio(format!("{path}: the file is empty")));
        }
        Ok(match input {
            Input::File(_) => Source::File(path.into()),
            Input::Bytes(bytes) => Source::Memory(bytes.into_inner().into()),
        })
    }

    /// Begins a new pass from the start.
    ///
    /// # Errors
    /// `Io` if the file is no longer there.
    pub(super) fn read(&self) -> Result<Reading> {
        Ok(match self {
            Source::File(path) => Reading::File(Input::open(path, InputKind::Sound)?),
            Source::Memory(bytes) => Reading::Memory(Cursor::new(Arc::clone(bytes))),
            Source::Behind {
                header,
                inner,
                from,
                length,
            } => Reading::Behind {
                header: Arc::clone(header),
                inner: Box::new(inner.read()?),
                from: *from,
                length: *length,
                at: 0,
            },
        })
    }

    /// The bytes of `header`, then `length` bytes of this source from `from` on.
    pub(super) fn behind(self, header: &[u8], from: u64, length: u64) -> Source {
        Source::Behind {
            header: header.into(),
            inner: Arc::new(self),
            from,
            length,
        }
    }
}

impl Read for Reading {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Reading::File(file) => file.read(into),
            Reading::Memory(bytes) => bytes.read(into),
            Reading::Behind {
                header,
                inner,
                from,
                length,
                at,
            } => {
                let start = header.len() as u64;
                let read = match at.checked_sub(start) {
                    None => (&header[*at as usize..]).read(into)?,
                    Some(inside) => {
                        inner.seek(SeekFrom::Start(from.saturating_add(inside)))?;
                        inner.take(length.saturating_sub(inside)).read(into)?
                    }
                };
                *at += read as u64;
                Ok(read)
            }
        }
    }
}

impl Seek for Reading {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Reading::File(file) => file.seek(to),
            Reading::Memory(bytes) => bytes.seek(to),
            Reading::Behind {
                header, length, at, ..
            } => {
                let place = match to {
                    SeekFrom::Start(place) => Some(place),
                    SeekFrom::End(by) => (header.len() as u64 + *length).checked_add_signed(by),
                    SeekFrom::Current(by) => at.checked_add_signed(by),
                };
                *at = place.ok_or(io::ErrorKind::InvalidInput)?;
                Ok(*at)
            }
        }
    }
}

impl MediaSource for Reading {
    fn is_seekable(&self) -> bool {
        true
    }

    fn byte_len(&self) -> Option<u64> {
        match self {
            Reading::File(file) => file.length().ok(),
            Reading::Memory(bytes) => Some(bytes.get_ref().len() as u64),
            Reading::Behind { header, length, .. } => Some(header.len() as u64 + length),
        }
    }
}
