//! Eyes that are one surface with their lids, cut free, and shut once to see that they shut well.

use ndarray::Axis;

use crate::{
    Engine, Error, Result,
    face::{EyeTrial, Face, Lids, OpenedFace, open_eyes},
    job::ProgressFn,
    motion::{LandmarkClip, Motion},
    spread::Collector,
};

impl Engine {
    /// Cuts free the eyes of a face that are one surface with their lids, gives the lids a lining and the eyes balls. The
    /// result blinks once: its lids have to shut over the whole eye, and no skin may turn over.
    ///
    /// # Errors
    /// Those of [`open_eyes`] and [`Engine::prepare`]; `Mesh` where the trial fails.
    pub fn open_eyes(&self, face: &Face, progress: ProgressFn<'_>) -> Result<OpenedFace> {
        let opened = open_eyes(face)?;
        for trial in self.eye_trials(face, &opened, progress)? {
            trial.check()?;
        }
        Ok(opened)
    }

    /// Makes the eyes that were cut free blink, and measures what they do. `face`: the face before the cut.
    ///
    /// # Errors
    /// Those of [`Engine::prepare`]; `Mesh` where lids still do not close.
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
