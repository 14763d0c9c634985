//! A glTF document that is being built, and how it is written to a file.

use std::{collections::BTreeMap, io::Write, path::Path};

use serde_json::Value;

use super::bytes::Bytes;
use crate::{Error, Result};

/// A glTF that is being built.
pub struct Document {
    pub json: Value,
    pub binary: Bytes,
    /// The meshes that show shapes.
    pub bound: Vec<Bound>,
}

/// A mesh of the file and the targets that show shapes on it, old ones and new ones.
pub struct Bound {
    pub node: usize,
    pub mesh: usize,
    /// Number of the target of each shape, by the number of the shape.
    pub targets: BTreeMap<usize, usize>,
    /// How many of these targets are new, or had no displacements before.
    pub new: usize,
}

/// Writes the file at `path`.
///
/// # Errors
/// `InvalidInput` for more bytes than the format can count; `Io` if the file cannot be written.
pub fn write_document<W: Write>((file, path): (&mut W, &Path), document: Document) -> Result<()> {
    let mut json = document.json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = document.binary;
    binary.pad();
    let chunks = [(b"JSON", Bytes::from(json)), (b"BIN\0", binary)];
    let chunks = chunks.into_iter().filter(|(_, bytes)| bytes.len() > 0);
    let chunks: Vec<_> = chunks.collect();
    let length = 12
        + chunks
            .iter()
            .map(|(_, bytes)| 8 + bytes.len())
            .sum::<usize>();
    let length = number(length)?;
    let write = |file: &mut W, bytes: &[u8]| file.write_all(bytes).map_err(Error::io(path));
    write(file, b"glTF")?;
    write(file, &2u32.to_le_bytes())?;
    write(file, &length.to_le_bytes())?;
    for (kind, bytes) in chunks {
        write(file, &number(bytes.len())?.to_le_bytes())?;
        write(file, kind)?;
        bytes.write(file).map_err(Error::io(path))?;
    }
    Ok(())
}

/// A number of bytes for the format, which counts them in 32 bits.
fn number(bytes: usize) -> Result<u32> {
    u32::try_from(bytes).map_err(|_| {
        Error::InvalidInput(format!(
            "expected a GLB of less than 4 GB, got {bytes} bytes; write a shorter sound, or an .npz"
        ))
    })
}
