//! Lightwave MDD: counts, the time of every frame, then positions, all big-endian.

use std::io::{self, Write};

use super::cache::count;
use crate::spread::ClipStart;

/// Writes the counts and the times of the frames, in seconds from 0.
pub(super) fn write_header(file: &mut impl Write, start: &ClipStart<'_>) -> io::Result<()> {
    file.write_all(&count(start.frames)?.to_be_bytes())?;
    file.write_all(&count(start.mesh.positions.len())?.to_be_bytes())?;
    for t in 0..start.frames {
        let time_s = (t as f64 / start.fps) as f32;
        file.write_all(&time_s.to_be_bytes())?;
    }
    Ok(())
}
