//! Point cache 2: a 32-byte header and the positions of every frame, little-endian.

use std::io::{self, Write};

use super::mdd::count;
use crate::{deform::VertexClip, mesh::Mesh};

/// Writes positions, mesh units and axes; one sample a frame from frame 0 on.
pub(super) fn write(file: &mut impl Write, clip: &VertexClip, mesh: &Mesh) -> io::Result<()> {
    let (frames, vertices, _) = clip.displacements.dim();
    file.write_all(b"POINTCACHE2\0")?;
    file.write_all(&1i32.to_le_bytes())?;
    file.write_all(&count(vertices)?.to_le_bytes())?;
    // First frame and frames to a sample.
    file.write_all(&0f32.to_le_bytes())?;
    file.write_all(&1f32.to_le_bytes())?;
    file.write_all(&count(frames)?.to_le_bytes())?;
    for frame in clip.displacements.outer_iter() {
        for (moved, rest) in frame.outer_iter().zip(&mesh.positions) {
            for i in 0..3 {
                file.write_all(&(rest[i] + moved[i]).to_le_bytes())?;
            }
        }
    }
    Ok(())
}
