//! Sinks take the frames of a clip as they are made.

use ndarray::{Array3, Axis, concatenate};

use crate::{
    Error, Result,
    deform::VertexClip,
    job::{ProgressFn, memory::available},
    mesh::{Mesh, ibug::LANDMARKS},
};

/// Bytes of displacements in a block, unless the sink asks for another size.
const BLOCK_BYTES: usize = 64 << 20;

/// Number of frames in a block, unless the sink asks for another number.
pub fn frames_at_once(mesh: &Mesh) -> usize {
    BLOCK_BYTES / (mesh.positions.len() * 12).max(1)
}

/// What is known of a clip before its first frame.
#[derive(Debug, Clone, Copy)]
pub struct ClipStart<'a> {
    /// The mesh whose vertices move.
    pub mesh: &'a Mesh,
    /// Its landmarks at rest, `[68][3]`, mesh units.
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    /// Number of frames `T`.
    pub frames: usize,
    /// Frames per second.
    pub fps: f64,
}

/// Consecutive frames, mesh units.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameBlock {
    /// Displacements of all vertices, `[t, V, 3]`.
    pub displacements: Array3<f32>,
    /// Displacements of the landmarks, `[t, 68, 3]`: the landmark motion that moved the mesh. If
    /// something else moved it, they are read off its vertices.
    pub landmarks: Array3<f32>,
}

/// Takes the frames of a clip in order: [`FrameSink::begin`], any number of blocks, then
/// [`FrameSink::finish`]. An error in any of them ends the run.
pub trait FrameSink: Send {
    /// Begins a clip, before its first frame.
    ///
    /// # Errors
    /// Any error of the sink.
    fn begin(&mut self, start: &ClipStart<'_>) -> Result<()>;

    /// How many frames the sink wants at a time. By default as many as fit into 64 MiB.
    fn frames_at_once(&self, start: &ClipStart<'_>) -> usize {
        frames_at_once(start.mesh)
    }

    /// Takes the next frames.
    ///
    /// # Errors
    /// Any error of the sink.
    fn take(&mut self, block: FrameBlock) -> Result<()>;

    /// Ends the clip, after its last frame.
    ///
    /// # Errors
    /// Any error of the sink; `Cancelled`.
    fn finish(&mut self, progress: ProgressFn<'_>) -> Result<()>;
}

/// A finished performance on one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Animation {
    /// Displacement of every vertex, mesh units.
    pub vertices: VertexClip,
    /// `[68][3]`, mesh units.
    pub landmarks_neutral: [[f32; 3]; LANDMARKS],
    /// `[T, 68, 3]`, mesh units.
    pub landmark_displacements: Array3<f32>,
}

/// Checks, before any work is done, that the displacements of all frames fit into memory.
///
/// # Errors
/// `OutOfMemory`.
fn room_for(frames: usize, vertices: usize) -> Result<()> {
    let numbers = frames.saturating_mul(vertices).saturating_mul(3);
    let bytes = (numbers as u64).saturating_mul(4);
    let is_left = available().is_none_or(|left| bytes <= left);
    // A system that has this much memory may still refuse to give it in one piece.
    if is_left && Vec::<f32>::new().try_reserve_exact(numbers).is_ok() {
        Ok(())
    } else {
        Err(Error::OutOfMemory(format!(
            "{frames} frames of {vertices} vertices take {} MB: take them block by block or as a file",
            bytes >> 20
        )))
    }
}

/// Keeps all frames in memory.
pub struct Collector {
    fps: f64,
    vertices: usize,
    neutral: [[f32; 3]; LANDMARKS],
    displacements: Vec<Array3<f32>>,
    landmarks: Vec<Array3<f32>>,
}

impl Default for Collector {
    fn default() -> Self {
        Collector {
            fps: 0.0,
            vertices: 0,
            neutral: [[0.0; 3]; LANDMARKS],
            displacements: Vec::new(),
            landmarks: Vec::new(),
        }
    }
}

impl Collector {
    /// Calls `run` with a sink and returns all frames that `run` hands to it.
    ///
    /// # Errors
    /// Those of `run`.
    pub fn collect(
        run: impl FnOnce(&mut dyn FrameSink) -> Result<SpreadReport>,
    ) -> Result<Animation> {
        let mut collector = Collector::default();
        run(&mut collector)?;
        Ok(collector.into_animation())
    }

    /// The clip of all frames taken so far.
    pub fn into_animation(self) -> Animation {
        Animation {
            vertices: VertexClip {
                displacements: in_one_piece(self.displacements, self.vertices),
                fps: self.fps,
            },
            landmarks_neutral: self.neutral,
            landmark_displacements: in_one_piece(self.landmarks, LANDMARKS),
        }
    }
}

/// Joins blocks `[t, N, 3]` one after the other.
fn in_one_piece(mut blocks: Vec<Array3<f32>>, points: usize) -> Array3<f32> {
    match blocks.len() {
        1 => blocks.remove(0),
        0 => Array3::zeros((0, points, 3)),
        _ => {
            let views: Vec<_> = blocks.iter().map(|block| block.view()).collect();
            concatenate(Axis(0), &views).expect("blocks of one mesh")
        }
    }
}

impl FrameSink for Collector {
    fn begin(&mut self, start: &ClipStart<'_>) -> Result<()> {
        let (frames, vertices) = (start.frames, start.mesh.positions.len());
        room_for(frames, vertices)?;
        *self = Collector {
            fps: start.fps,
            vertices: start.mesh.positions.len(),
            neutral: *start.landmarks,
            displacements: Vec::new(),
            landmarks: Vec::new(),
        };
        Ok(())
    }

    fn frames_at_once(&self, start: &ClipStart<'_>) -> usize {
        start.frames
    }

    fn take(&mut self, block: FrameBlock) -> Result<()> {
        self.displacements.push(block.displacements);
        self.landmarks.push(block.landmarks);
        Ok(())
    }

    fn finish(&mut self, _progress: ProgressFn<'_>) -> Result<()> {
        Ok(())
    }
}

/// How far vertices and landmarks move, over all frames.
#[derive(Debug, Clone, PartialEq)]
pub struct SpreadReport {
    /// Largest displacement of any vertex, mesh units.
    pub largest: f32,
    /// Displacements of the landmarks, `[T, 68, 3]`, mesh units: the landmark motion that moved the
    /// mesh. If something else moved it, they are read off its vertices.
    pub landmarks: Array3<f32>,
    /// What the user should know.
    pub notes: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_that_no_memory_holds_is_an_error_before_any_work() {
        assert!(room_for(36_000, 9).is_ok());
        let error = room_for(usize::MAX / 100, 8_839).unwrap_err();
        assert!(
            matches!(&error, Error::OutOfMemory(m) if m.contains("8839 vertices")),
            "{error}"
        );
    }
}
