//! `anyface deform`: landmark motion from a file on a mesh.

use std::path::PathBuf;

use clap::Args;

use super::{
    arguments::{FaceArgs, SharedArgs},
    console::Console,
    stages::{new_report, note_face, spread_into, summary, timed},
};
use crate::{
    Result,
    mesh::{LandmarkSource, Mesh},
    motion::{LandmarkClip, Motion},
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
        note_face(&mut report, &face);
        let fps = motion.fps.unwrap_or(DEFAULT_FPS);
        let (progress, displacements) = (&|p| console.progress(p), motion.displacements);
        // Nothing is known of the speech, so lips may rest.
        spread_into(
            &self.out,
            &face,
            fps,
            0.0,
            None,
            &mut report,
            |sink| match motion.neutral {
                Some(_) => engine.spread_own(&face, displacements, fps, sink, progress),
                None => {
                    let clip = LandmarkClip { displacements, fps };
                    engine.spread(&face, &Motion::Landmarks(clip), sink, progress)
                }
            },
        )?;
        if let Some(path) = &self.report {
            write_json(path, &report)?;
        }
        console.report(&report, &summary(&report));
        Ok(())
    }
}
