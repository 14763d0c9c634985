//! Cuts free eyes that are one surface with their lids, and shuts them once to check the result.

use ndarray::Axis;

use crate::{
    Engine, Error, Result,
    face::{EyeTrial, Face, Lids, OpenedFace, open_eyes},
    job::ProgressFn,
    motion::{LandmarkClip, Motion},
    spread::Collector,
};

impl Engine {
    /// Cuts free the eyes of a face if they are one surface with their lids. The lids get a lining
    /// and the eyes get balls. The result then blinks once as a trial: the lids have to cover the
    /// whole eye, and the skin must not turn over.
    ///
    /// # Errors
    /// Those of [`open_eyes`] and [`Engine::prepare`]; `Mesh` if the trial fails.
    pub fn open_eyes(&self, face: &Face, progress: ProgressFn<'_>) -> Result<OpenedFace> {
        let opened = open_eyes(face)?;
        for trial in self.eye_trials(face, &opened, progress)? {
            trial.check()?;
        }
        Ok(opened)
    }

    /// Makes the eyes that were cut free blink, and measures the result. `face`: the face before
    /// the cut.
    ///
    /// # Errors
    /// Those of [`Engine::prepare`]; `Mesh` if the lids of an eye still do not close.
    pub fn eye_trials(
        &self,
        face: &Face,
        opened: &OpenedFace,
        progress: ProgressFn<'_>,
    ) -> Result<Vec<EyeTrial>> {
        let after = self.prepare(&opened.mesh, &opened.face_options(face), progress)?;
        let motion = Motion::Landmarks(LandmarkClip {
            displacements: EyeTrial::blink(),
            fps: 30.0,
        });
        let clip = Collector::collect(|sink| self.spread(&after, &motion, sink, progress))?;
        let moved = clip.vertices.displacements;
        let joined = (0..2).filter(|&eye| face.lids()[eye] == Lids::Joined);
        let trial = |eye: usize| {
            match after.openings().of_eye(eye) {
            Some(opening) if opening.lids == Lids::Close => {
                Ok(EyeTrial::of(&after, opening, moved.index_axis(Axis(0), 0)))
            }
            _ => Err(Error::Mesh(
                "open eyes: expected a ball in each eye that was cut free, got another shape; the mesh is as it was"
                    .into(),
            )),
        }
        };
        joined.map(trial).collect()
    }
}
