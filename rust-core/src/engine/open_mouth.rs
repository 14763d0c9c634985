//! Lips that are one surface, parted, and opened once to see that they part well.

use crate::{
    Engine, Result,
    face::{Face, MouthTrial, OpenedFace, open_mouth},
    job::ProgressFn,
    motion::{LandmarkClip, Motion},
    spread::Collector,
};

impl Engine {
    /// Parts the lips of a face along the valley between them and sews the inside of a mouth behind them. The jaw of
    /// the result is dropped by 20 mm once: the rims have to part as the landmarks say, alike on both sides.
    ///
    /// # Errors
    /// Those of [`open_mouth`] and [`Engine::prepare`]; `Mesh` where the trial fails.
    pub fn open_mouth(&self, face: &Face, progress: ProgressFn<'_>) -> Result<OpenedFace> {
        let opened = open_mouth(&face.mesh, &face.landmarks)?;
        self.mouth_trial(face, &opened, progress)?.check()?;
        Ok(opened)
    }

    /// What the rims of an opened mouth do when its jaw drops by 20 mm. `face`: before it was opened.
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
