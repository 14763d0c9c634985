//! `anyface animate`: speech and a mesh to vertex displacements.

use std::path::PathBuf;

use clap::Args;

use super::{
    arguments::{FaceArgs, MotionArgs, SharedArgs},
    console::Console,
    stages::{deform_into, new_report, note_landmarks, note_mouth, read_sound, summary, timed},
};
use crate::{
    Result,
    mesh::{Mesh, Mouth},
    output::{Format, warnings_of_motion, write_json},
};

/// Animate a mesh with speech
#[derive(Args)]
pub(super) struct Animate {
    /// The mesh: OBJ, PLY or GLB
    #[arg(long, value_name = "M")]
    mesh: PathBuf,
    /// The speech: WAV, MP3, FLAC, Ogg Vorbis, M4A or AIFF
    #[arg(long, value_name = "A")]
    audio: PathBuf,
    /// The result: .npz (arrays), .pc2 or .mdd (point caches)
    #[arg(long, value_name = "O")]
    out: PathBuf,
    /// Also write a report of the run
    #[arg(long, value_name = "R.json")]
    report: Option<PathBuf>,
    #[command(flatten)]
    face: FaceArgs,
    #[command(flatten)]
    motion: MotionArgs,
}

impl Animate {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        // What is cheap to check comes before what takes time.
        Format::from_path(&self.out)?;
        let request = self.motion.request()?;
        let options = self.face.options(&self.mesh, None)?;
        let mut report = new_report();
        let waveform = read_sound(&mut report, &self.audio)?;
        let mesh = timed(&mut report, "read", || Mesh::read(&self.mesh))?;
        let progress = &|p| console.progress(p);
        let engine = timed(&mut report, "load", || shared.engine())?;
        let face = timed(&mut report, "prepare", || {
            engine.prepare(&mesh, &options, progress)
        })?;
        note_landmarks(&mut report, &face.landmarks.confidence);
        note_mouth(&mut report, Mouth::of(&mesh, &face.landmarks));
        let motion = timed(&mut report, "motion", || {
            engine.motion(&waveform, &request, progress)
        })?;
        report.warnings.extend(warnings_of_motion(&motion));
        let landmarks = face
            .to_canonical
            .displacements_to_mesh(motion.displacements.view());
        deform_into(
            &self.out,
            &mesh,
            &face,
            landmarks.view(),
            motion.fps,
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
