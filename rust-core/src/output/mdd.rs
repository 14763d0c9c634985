//! Lightwave MDD: counts, the time of every frame, then positions, all big-endian.

use std::io::{self, Write};

use crate::{deform::VertexClip, mesh::Mesh};

/// Writes positions, mesh units and axes; times in seconds from 0.
pub(super) fn write(file: &mut impl Write, clip: &VertexClip, mesh: &Mesh) -> io::Result<()> {
    let (frames, vertices, _) = clip.displacements.dim();
    file.write_all(&count(frames)?.to_be_bytes())?;
    file.write_all(&count(vertices)?.to_be_bytes())?;
    for t in 0..frames {
        let time_s = (t as f64 / clip.fps) as f32;
        file.write_all(&time_s.to_be_bytes())?;
    }
    for frame in clip.displacements.outer_iter() {
        for (moved, rest) in frame.outer_iter().zip(&mesh.positions) {
            for i in 0..3 {
                file.write_all(&(rest[i] + moved[i]).to_be_bytes())?;
            }
        }
    }
    Ok(())
}

/// Point caches count in 32 signed bits.
pub(super) fn count(n: usize) -> io::Result<i32> {
    i32::try_from(n).map_err(|_| io::Error::other(format!("expected at most 2^31 − 1, got {n}")))
}
