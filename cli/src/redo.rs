//! Makes a stretch of an earlier result again.

use std::path::Path;

use anyface::{
    Engine, Error, Face, Performance, Result,
    deform::VertexClip,
    job::ProgressFn,
    mesh::Mesh,
    motion::{LandmarkClip, Life, Motion, Stretch, WeightClip},
    output::{ClipFile, Format, read_landmark_motion, read_life, read_vertex_motion, read_weights},
    spread::{Animation, Collector, Movement, SpreadReport},
};
use clap::Args;
use ndarray::Array3;

use crate::paths::InputPath;

/// Options for making a stretch again.
#[derive(Args)]
pub struct RedoArgs {
    /// Make only these seconds again, blended at the ends. Every frame outside stays the same to the bit
    #[arg(long, value_name = "S-S", requires = "from", value_parser = Stretch::parse)]
    redo: Option<Stretch>,
    /// The earlier result, .npz, of the same mesh, sound and frame rate
    #[arg(long, value_name = "T.npz", requires = "redo")]
    from: Option<InputPath>,
}

/// The stretch to make again, and the file of the earlier result.
pub struct Redo<'a> {
    stretch: Stretch,
    from: &'a Path,
}

impl RedoArgs {
    /// The stretch and its file, or `None` without --redo. Checks the name of the file but does not open it.
    pub fn request(&self) -> Result<Option<Redo<'_>>> {
        let (Some(stretch), Some(from)) = (self.redo, self.from.as_deref()) else {
            return Ok(None);
        };
        if Format::from_path(from)? != Format::Npz {
            return Err(Error::InvalidInput(format!(
                "{}: expected a name that ends in .npz to make a stretch of it again",
                from.display()
            )));
        }
        Ok(Some(Redo { stretch, from }))
    }
}

impl Redo<'_> {
    /// Writes the earlier animation to `out`, with the stretch taken from `performance`.
    pub fn animate(
        &self,
        engine: &Engine,
        face: &Face,
        performance: &Performance,
        out: ClipFile,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        let motion = &performance.motion;
        let (frames, fps) = (motion.frames(), motion.fps());
        let mut was = self.animation(&face.mesh)?;
        self.check(
            was.vertices.displacements.dim().0,
            was.vertices.fps,
            frames,
            fps,
        )?;
        let rows = self.stretch.frames(frames, fps)?;
        let part = motion.frames_of(rows.clone());
        let life = performance.life.frames_of(rows.clone());
        let mut notes = Vec::new();
        let new = Collector::collect(|sink| {
            let part = Movement::from(&part).with_tongue(&life);
            let spread = engine.spread(face, part, sink, progress)?;
            notes.clone_from(&spread.notes);
            Ok(spread)
        })?;
        let splice = |was: &mut Array3<f32>, new: Array3<f32>| -> Result<()> {
            let mut whole = was.clone();
            let rows = ndarray::Slice::from(rows.clone());
            whole.slice_axis_mut(ndarray::Axis(0), rows).assign(&new);
            *was = self.stretch.splice(was.view(), whole.view(), fps)?;
            Ok(())
        };
        splice(&mut was.vertices.displacements, new.vertices.displacements)?;
        splice(&mut was.landmark_displacements, new.landmark_displacements)?;
        let life = self.life(&performance.life, fps)?;
        out.write_whole(&was, Some(&life), &face.mesh)?;
        Ok(SpreadReport {
            largest: largest(&was.vertices.displacements),
            landmarks: was.landmark_displacements,
            notes,
        })
    }

    /// Returns motion and life of the earlier file, with the stretch taken from `performance`.
    pub fn motion(&self, performance: &Performance) -> Result<(Motion, Life)> {
        let new = &performance.motion;
        let was = match new {
            Motion::Weights(clip) => Motion::Weights(self.weights(clip)?),
            _ => Motion::Landmarks(self.landmarks(new)?),
        };
        self.check(was.frames(), was.fps(), new.frames(), new.fps())?;
        let redone = match new {
            // Motion files hold no codes.
            Motion::Codes(new) => {
                was.redone(&Motion::Landmarks(new.landmarks.clone()), &self.stretch)?
            }
            _ => was.redone(new, &self.stretch)?,
        };
        Ok((redone, self.life(&performance.life, new.fps())?))
    }

    /// The weights of the file, whose shapes must be those of `new` in the same order.
    fn weights(&self, new: &WeightClip) -> Result<WeightClip> {
        match read_weights(self.from)? {
            Some(was) if was.names == new.names => Ok(was),
            Some(_) => Err(self.wrong("the shapes of this system, got others")),
            None => Err(self.wrong("arrays weights and names, got none")),
        }
    }

    fn landmarks(&self, new: &Motion) -> Result<LandmarkClip> {
        let was = read_landmark_motion(self.from)?;
        if was.neutral.is_some() {
            return Err(self.wrong("landmark motion in metres, got that of a mesh"));
        }
        Ok(LandmarkClip {
            displacements: was.displacements,
            fps: was.fps.unwrap_or(new.fps()),
        })
    }

    fn animation(&self, mesh: &Mesh) -> Result<Animation> {
        let vertices = read_vertex_motion(self.from, mesh)?;
        let landmarks = read_landmark_motion(self.from)?;
        let (Some(fps), Some(landmarks_neutral)) = (vertices.fps, landmarks.neutral) else {
            return Err(self.wrong("arrays fps and landmarks_neutral, got none"));
        };
        let frames = vertices.displacements.dim().0;
        let of_landmarks = landmarks.displacements.dim().0;
        if frames != of_landmarks {
            return Err(self.wrong(&format!(
                "as many frames of landmarks as of vertices, {frames}, got {of_landmarks}"
            )));
        }
        Ok(Animation {
            vertices: VertexClip {
                displacements: vertices.displacements,
                fps,
            },
            landmarks_neutral,
            landmark_displacements: landmarks.displacements,
        })
    }

    fn life(&self, new: &Life, fps: f64) -> Result<Life> {
        match read_life(self.from)? {
            Some(was) => was.redone(new, &self.stretch, fps),
            None => Err(self.wrong("arrays head and gaze, got none")),
        }
    }

    fn check(&self, frames: usize, fps: f64, new_frames: usize, new_fps: f64) -> Result<()> {
        if (frames, fps) == (new_frames, new_fps) {
            Ok(())
        } else {
            Err(self.wrong(&format!(
                "{new_frames} frames at {new_fps} fps as of this sound, got {frames} at {fps} fps"
            )))
        }
    }

    fn wrong(&self, expected: &str) -> Error {
        Error::InvalidInput(format!("{}: expected {expected}", self.from.display()))
    }
}

/// Largest displacement of any vertex.
fn largest(displacements: &Array3<f32>) -> f32 {
    let vectors = displacements.rows();
    let lengths = vectors.into_iter().map(|moved| moved.dot(&moved));
    lengths.fold(0.0, f32::max).sqrt()
}
