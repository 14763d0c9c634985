//! A glTF in the making, and its bytes in a file.

use std::{io::Write, path::Path};

use serde_json::Value;

use crate::{Error, Result};

/// A file in the making.
pub struct Document {
    pub json: Value,
    pub binary: Vec<u8>,
    /// Where the shapes stand.
    pub bound: Vec<Bound>,
}

/// Which shapes a mesh of the file has become targets of.
pub struct Bound {
    pub node: usize,
    pub mesh: usize,
    /// Targets that the mesh had before.
    pub before: usize,
    /// Numbers of the shapes, a target each behind those.
    pub shapes: Vec<usize>,
}

/// Writes the file at `path`.
///
/// # Errors
/// `InvalidInput` for more than the format counts, and `Io` of the writer.
pub fn write_document((file, path): (&mut impl Write, &Path), document: Document) -> Result<()> {
    let mut json = document.json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = document.binary;
    binary.resize(binary.len().next_multiple_of(4), 0);
    let chunks = [(b"JSON", &json), (b"BIN\0", &binary)];
    let chunks = chunks.iter().filter(|(_, bytes)| !bytes.is_empty());
    let length = 12
        + chunks
            .clone()
            .map(|(_, bytes)| 8 + bytes.len())
            .sum::<usize>();
    let length = number(length)?;
    let mut write = |bytes: &[u8]| file.write_all(bytes).map_err(Error::io(path));
    write(b"glTF")?;
    write(&2u32.to_le_bytes())?;
    write(&length.to_le_bytes())?;
    for (kind, bytes) in chunks {
        write(&number(bytes.len())?.to_le_bytes())?;
        write(*kind)?;
        write(bytes)?;
    }
    Ok(())
}

/// The format counts its bytes in 32 bits.
fn number(bytes: usize) -> Result<u32> {
    u32::try_from(bytes).map_err(|_| {
        Error::InvalidInput(format!(
            "expected a GLB of less than 4 GB, got {bytes} bytes; write a shorter sound, or an .npz"
        ))
    })
}
