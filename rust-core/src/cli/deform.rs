//! `anyface deform`: landmark motion from a file on a mesh.

use std::path::PathBuf;

use clap::Args;

use super::{
    arguments::{FaceArgs, SharedArgs},
    console::Console,
    stages::{deform_into, new_report, note_landmarks, note_mouth, summary, timed},
};
use crate::{
    Result,
    mesh::{LandmarkSource, Mesh, Mouth},
    output::{Format, read_landmark_motion, write_json},
};

/// Frame rate of motion files that do not state theirs.
const DEFAULT_FPS: f64 = 30.0;

/// Put landmark motion on a mesh
#[derive(Args)]
pub(super) struct Deform {
    /// The mesh: OBJ, PLY or GLB
    #[arg(long, value_name = "M")]
    mesh: PathBuf,
    /// Motion, .npz: landmarks_neutral [68, 3] and landmark_displacements [T, 68, 3] in mesh
    /// units; without landmarks_neutral, the displacements are metres on a human head, as
    /// `anyface motion` writes them
    #[arg(long, value_name = "L.npz")]
    motion: PathBuf,
    /// The result: .npz (arrays), .pc2 or .mdd (point caches)
    #[arg(long, value_name = "O")]
    out: PathBuf,
    /// Also write a report of the run
    #[arg(long, value_name = "R.json")]
    report: Option<PathBuf>,
    #[command(flatten)]
    face: FaceArgs,
}

impl Deform {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        Format::from_path(&self.out)?;
        let mut report = new_report();
        let motion = timed(&mut report, "read", || read_landmark_motion(&self.motion))?;
        let mesh = timed(&mut report, "read", || Mesh::read(&self.mesh))?;
        let known = motion
            .neutral
            .map(|neutral| LandmarkSource::Positions(neutral.to_vec()));
        let options = self.face.options(&self.mesh, known)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        let face = timed(&mut report, "prepare", || {
            engine.prepare(&mesh, &options, &|p| console.progress(p))
        })?;
        note_landmarks(&mut report, &face.landmarks.confidence);
        note_mouth(&mut report, Mouth::of(&mesh, &face.landmarks));
        let landmarks = match motion.neutral {
            Some(_) => motion.displacements,
            None => face
                .to_canonical
                .displacements_to_mesh(motion.displacements.view()),
        };
        deform_into(
            &self.out,
            &mesh,
            &face,
            landmarks.view(),
            motion.fps.unwrap_or(DEFAULT_FPS),
            &mut report,
            console,
        )?;
        if let Some(path) = &self.report {
            write_json(path, &report)?;
        }
        console.report(&report, &summary(&report));
        Ok(())
    }
}
