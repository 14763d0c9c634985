//! Lightwave MDD: counts, the time of every frame, then positions, all big-endian.

use std::io::{self, Write};

use super::{ClipShape, cache::count};

/// Times in seconds from 0.
pub(super) fn write_header(file: &mut impl Write, shape: &ClipShape) -> io::Result<()> {
    file.write_all(&count(shape.frames)?.to_be_bytes())?;
    file.write_all(&count(shape.vertices)?.to_be_bytes())?;
    for t in 0..shape.frames {
        let time_s = (t as f64 / shape.fps) as f32;
        file.write_all(&time_s.to_be_bytes())?;
    }
    Ok(())
}
