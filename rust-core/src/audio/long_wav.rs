//! WAV with 64-bit lengths: RF64 and BW64 (EBU Tech 3306), and Sony's Wave64.
//!
//! WAV readers know none of these, so they get the same samples behind a header of 32-bit lengths.

use std::io::{Read, Seek, SeekFrom};

use super::{source::Source, wav::LENGTH_UNKNOWN};
use crate::{Error, Result};

/// GUIDs of Wave64. The first four bytes of a chunk's GUID are its name.
const W64_RIFF: [u8; 16] = *b"riff\x2e\x91\xcf\x11\xa5\xd6\x28\xdb\x04\xc1\x00\x00";
const W64_WAVE: [u8; 16] = *b"wave\xf3\xac\xd3\x11\x8c\xd1\x00\xc0\x4f\x8e\xdb\x8a";
/// The most chunks that are searched for the samples.
const MAX_CHUNKS: usize = 1_000;
/// The largest `fmt ` chunk that is accepted, bytes.
const LARGEST_FORMAT: u64 = 4_096;

/// A chunk, as its header describes it.
struct Chunk {
    name: [u8; 4],
    /// Where its body begins, and the length of the body in bytes.
    from: u64,
    length: u64,
    /// Where the next chunk begins.
    next: u64,
}

/// The format of the file, which decides how chunk headers look.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Rf64,
    Wave64,
}

/// Turns a WAV with long lengths into a plain one. Returns any other source as it is.
///
/// # Errors
/// `Audio` if its chunks do not lead to samples, or the samples take almost 2 GiB or more.
pub(super) fn as_wav(source: Source) -> Result<Source> {
    let mut file = source.read()?;
    let mut start = Vec::new();
    let read = file.by_ref().take(40).read_to_end(&mut start);
    let is = |magic: &[u8], at: usize, name: &[u8]| {
        start.starts_with(magic) && start.get(at..at + name.len()) == Some(name)
    };
    let kind = match read {
        Ok(_) if is(b"RF64", 8, b"WAVE") || is(b"BW64", 8, b"WAVE") => Kind::Rf64,
        Ok(_) if is(&W64_RIFF, 24, &W64_WAVE) => Kind::Wave64,
        _ => return Ok(source),
    };
    let refuse = |what: &str| Error::Audio(format!("expected a WAV with long lengths, {what}"));
    let mut at = if kind == Kind::Rf64 { 12 } else { 40 };
    let (mut format, mut long_length) = (None, None);
    for _ in 0..MAX_CHUNKS {
        let chunk = chunk(&mut file, kind, at)
            .ok_or_else(|| refuse("got a file that ends before its samples"))?;
        match &chunk.name {
            b"ds64" => {
                // The length of the file, then the length of the samples.
                let body = body(&mut file, &chunk, 16);
                long_length = body.map(|b| u64_at(&b, 8));
            }
            b"fmt " if chunk.length <= LARGEST_FORMAT => {
                format = body(&mut file, &chunk, chunk.length);
            }
            b"data" => {
                let format = format.ok_or_else(|| refuse("got samples before their format"))?;
                let is_long = kind == Kind::Rf64 && chunk.length == u64::from(u32::MAX);
                let length = match long_length {
                    Some(length) if is_long => length,
                    _ => chunk.length,
                };
                if length >= LENGTH_UNKNOWN {
                    return Err(Error::Audio(format!(
                        "expected at most {LENGTH_UNKNOWN} bytes of samples, got {length}; divide the recording"
                    )));
                }
                return Ok(source.behind(&header(&format, length), chunk.from, length));
            }
            _ => {}
        }
        at = chunk.next;
    }
    Err(refuse("got no samples among its first chunks"))
}

/// The chunk whose header begins at `at`; `None` at the end of the file.
fn chunk(file: &mut (impl Read + Seek), kind: Kind, at: u64) -> Option<Chunk> {
    file.seek(SeekFrom::Start(at)).ok()?;
    let mut head = [0; 24];
    let size = if kind == Kind::Rf64 { 8 } else { 24 };
    file.read_exact(&mut head[..size]).ok()?;
    let from = at.checked_add(size as u64)?;
    let (length, to) = match kind {
        Kind::Rf64 => {
            let length = u64::from(u32::from_le_bytes(head[4..8].try_into().ok()?));
            (length, length.checked_next_multiple_of(2)?)
        }
        // The length includes the header. Chunks begin at multiples of eight.
        Kind::Wave64 => {
            let length = u64_at(&head, 16).checked_sub(24)?;
            (length, length.checked_next_multiple_of(8)?)
        }
    };
    Some(Chunk {
        name: head[..4].try_into().ok()?,
        from,
        length,
        next: from.checked_add(to)?,
    })
}

/// The first `length` bytes of a chunk; `None` if it has fewer.
fn body(file: &mut (impl Read + Seek), chunk: &Chunk, length: u64) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(chunk.from)).ok()?;
    file.take(length.min(chunk.length))
        .read_to_end(&mut bytes)
        .ok()?;
    (bytes.len() as u64 == length).then_some(bytes)
}

/// A plain WAV header for `length` bytes of samples, below 2 GiB.
fn header(format: &[u8], length: u64) -> Vec<u8> {
    let length = length as u32;
    let mut header = b"RIFF".to_vec();
    header.extend((20 + format.len() as u32 + length).to_le_bytes());
    header.extend(b"WAVEfmt ");
    header.extend((format.len() as u32).to_le_bytes());
    header.extend(format);
    header.extend(b"data");
    header.extend(length.to_le_bytes());
    header
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let eight = bytes.get(at..at + 8).and_then(|b| b.try_into().ok());
    eight.map_or(0, u64::from_le_bytes)
}
