//! Point cache 2: a 32-byte header and the positions of every frame, little-endian.

use std::io::{self, Write};

use super::cache::count;
use crate::spread::ClipStart;

/// Writes the header for one sample per frame, from frame 0 on.
pub(super) fn write_header(file: &mut impl Write, start: &ClipStart<'_>) -> io::Result<()> {
    file.write_all(b"POINTCACHE2\0")?;
    file.write_all(&1i32.to_le_bytes())?;
    file.write_all(&count(start.mesh.positions.len())?.to_le_bytes())?;
    // First frame, and frames per sample.
    file.write_all(&0f32.to_le_bytes())?;
    file.write_all(&1f32.to_le_bytes())?;
    file.write_all(&count(start.frames)?.to_le_bytes())
}
