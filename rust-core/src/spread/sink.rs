//! Where frames go as they are made.

use ndarray::{Array3, Axis, concatenate};

use crate::{
    Error, Result,
    deform::VertexClip,
    job::memory::available,
    mesh::{Mesh, ibug::LANDMARKS},
};

/// Bytes of displacements that are made at a time where a sink says nothing else.
const BLOCK_BYTES: usize = 64 << 20;

/// Frames of a block where a sink says nothing else.
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

/// Frames that follow each other, mesh units.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameBlock {
    /// Of all vertices, `[t, V, 3]`.
    pub displacements: Array3<f32>,
    /// Of the landmarks, `[t, 68, 3]`: what moved the mesh, or what is read off it where that was no motion of landmarks.
    pub landmarks: Array3<f32>,
}

/// Takes the frames of a clip in order: [`FrameSink::begin`], any number of blocks, then
/// [`FrameSink::finish`]. An error of any of them ends the run.
pub trait FrameSink: Send {
    /// Hears what is to come.
    ///
    /// # Errors
    /// Whatever hinders the sink.
    fn begin(&mut self, start: &ClipStart<'_>) -> Result<()>;

    /// How many frames it wants to get at a time: 64 MiB of them unless it says something else.
    fn frames_at_once(&self, start: &ClipStart<'_>) -> usize {
        frames_at_once(start.mesh)
    }

    /// Takes the next frames.
    ///
    /// # Errors
    /// Whatever hinders the sink.
    fn take(&mut self, block: FrameBlock) -> Result<()>;

    /// Hears that all frames were taken.
    ///
    /// # Errors
    /// Whatever hinders the sink.
    fn finish(&mut self) -> Result<()>;
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

/// Whether displacements of all frames fit into memory, asked before the work is done.
///
/// # Errors
/// `OutOfMemory`.
fn room_for(frames: usize, vertices: usize) -> Result<()> {
    let numbers = frames.saturating_mul(vertices).saturating_mul(3);
    let bytes = (numbers as u64).saturating_mul(4);
    let is_left = available().is_none_or(|left| bytes <= left);
    // A system that has it may still refuse it in one piece.
    match is_left && Vec::<f32>::new().try_reserve_exact(numbers).is_ok() {
        true => Ok(()),
        false => Err(Error::OutOfMemory(format!(
            "{frames} frames of {vertices} vertices take {} MB: take them block by block or as a file",
            bytes >> 20
        ))),
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
    /// All frames that `run` hands to the sink that it gets.
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

    /// The clip that was collected; one of no frames where the run did not end.
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

/// Blocks `[t, N, 3]` behind each other.
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

    fn finish(&mut self) -> Result<()> {
        Ok(())
    }
}

/// How far things move, over all frames.
#[derive(Debug, Clone, PartialEq)]
pub struct SpreadReport {
    /// Largest displacement of any vertex, mesh units.
    pub largest: f32,
    /// `[T, 68, 3]`, mesh units: what moved the mesh, or what is read off it where that was no motion
    /// of landmarks.
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
