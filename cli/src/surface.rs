//! Options for the result and the report of an animation.
//!
//! The result is either one file with the vertices of the mesh, or one file a frame with the surface of the
//! head that resembles the mesh.

use std::path::Path;

use anyface::{
    Engine, Error, Face, Result,
    head::check_surface_cells,
    job::{ProgressFn, write_json},
    motion::{Extent, Motion},
    output::{Format, Report, check_new_folder, write_surface_frames},
    systems::Ability,
};
use clap::Args;

use crate::{
    arguments::shown,
    console::Console,
    paths::{OutputPath, is_folder},
    stages::{summary, timed},
};

/// Options of the report and of the surface.
#[derive(Args)]
pub struct SurfaceArgs {
    /// Also write a report of the run
    #[arg(long, value_name = "R.json")]
    report: Option<OutputPath>,
    /// Write the surface of the head that resembles the mesh instead (facetalk), one PLY for each frame.
    /// Its grid has N cells along its longest side, 32 to 512
    #[arg(long, value_name = "N")]
    surface: Option<usize>,
}

impl SurfaceArgs {
    pub fn is_asked(&self) -> bool {
        self.surface.is_some()
    }

    /// Makes the checks that need no engine.
    pub fn check(&self, out: &Path) -> Result<()> {
        let Some(cells) = self.surface else {
            return Format::from_path(out).map(drop);
        };
        check_surface_cells(cells)?;
        if !is_folder(out) {
            return Err(Error::InvalidInput(format!(
                "{}: expected a folder for the frames of a surface, as in frames/",
                out.display()
            )));
        }
        check_new_folder(out)
    }

    /// Checks that the system can make a surface, if one is asked for.
    pub fn check_system(&self, engine: &Engine) -> Result<()> {
        if self.is_asked() {
            engine.system().require(Ability::Head, "surface")
        } else {
            Ok(())
        }
    }

    /// Writes the report to its file and to the console.
    pub fn tell(&self, report: &Report, console: &Console) -> Result<()> {
        if let Some(path) = &self.report {
            write_json(path, report)?;
        }
        console.report(report, &summary(report))
    }

    /// Writes the frames into the folder `out` and notes them in the report. `articulation` is the requested
    /// articulation of the lips.
    pub fn write(
        &self,
        (engine, face): (&Engine, &Face),
        (motion, articulation): (&Motion, f32),
        out: &Path,
        report: &mut Report,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let (Some(cells), Motion::Codes(clip)) = (self.surface, motion) else {
            return Err(Error::InvalidInput(
                "surface: expected a model with landmark_motion, which goes by landmarks, got one without".into(),
            ));
        };
        let (surface, note) = timed(report, "surface", || {
            engine.head_surface(face, cells, progress)
        })?;
        let codes = timed(report, "codes", || {
            let landmarks = clip.landmarks.displacements.view();
            surface.led_codes(clip.codes.view(), landmarks, progress)
        })?;
        let largest = timed(report, "write", || {
            write_surface_frames(out, &surface, codes.view(), progress)
        })?;
        report.warnings.extend(note);
        let landmarks = engine.landmarks_of(motion)?.displacements;
        let landmarks = face.motion_on_mesh(landmarks.view());
        let extent = Extent::of(Some(largest), landmarks.view());
        report.note_motion(&extent, face.metres_per_unit(), articulation);
        report.out = Some(shown(out));
        report.frames = motion.frames();
        report.fps = motion.fps();
        report.vertices = Some(surface.vertices());
        Ok(())
    }
}
