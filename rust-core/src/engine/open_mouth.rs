//! Parts lips that are one surface, and opens them once to check the result.

use crate::{
    Engine, Result,
    face::{Face, MouthTrial, OpenedFace, open_mouth},
    job::ProgressFn,
    motion::{LandmarkClip, Motion},
    spread::Collector,
};

impl Engine {
    /// Parts the lips of a face along the valley between them, and sews the inside of a mouth
    /// behind them. As a trial, the jaw of the result then drops once by 20 mm: the rims have to
    /// part as far as the landmarks say, equally on both sides.
    ///
    /// # Errors
    /// Those of [`open_mouth`] and [`Engine::prepare`]; `Mesh` if the trial fails.
    pub fn open_mouth(&self, face: &Face, progress: ProgressFn<'_>) -> Result<OpenedFace> {
        let opened = open_mouth(&face.mesh, &face.landmarks)?;
        self.mouth_trial(face, &opened, progress)?.check()?;
        Ok(opened)
    }

    /// Measures how the rims of an opened mouth move when the jaw drops by 20 mm. `face`: the face
    /// before the mouth was opened.
    ///
    /// # Errors
    /// Those of [`Engine::prepare`].
    pub fn mouth_trial(
        &self,
        face: &Face,
        opened: &OpenedFace,
        progress: ProgressFn<'_>,
    ) -> Result<MouthTrial> {
        let after = self.prepare(&opened.mesh, &opened.face_options(face), progress)?;
        let motion = Motion::Landmarks(LandmarkClip {
            displacements: MouthTrial::jaw_drop(),
            fps: 30.0,
        });
        let clip = Collector::collect(|sink| self.spread(&after, &motion, sink, progress))?;
        let moved = clip.vertices.displacements;
        opened.trial(moved.index_axis(ndarray::Axis(0), 0))
    }
}
