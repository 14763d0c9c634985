//! The surface of the head that a mesh is like, a file for each frame.

use std::path::Path;

use anyface::{
    Engine, Error, Face, Result,
    head::check_surface_cells,
    motion::{CodeClip, Motion},
    output::{Report, check_new_folder, write_surface_frames},
    progress::ProgressFn,
};
use clap::Args;

use crate::{
    arguments::{is_folder, shown},
    stages::timed,
};

/// Options of a surface over time.
#[derive(Args)]
pub struct SurfaceArgs {
    /// Write the surface of the head that is like the mesh instead (facetalk), a PLY for each frame: cells along
    /// its longest side, 32 to 512
    #[arg(long, value_name = "N")]
    surface: Option<usize>,
}

impl SurfaceArgs {
    pub fn is_asked(&self) -> bool {
        self.surface.is_some()
    }

    /// Checks what is cheap to check.
    pub fn check(&self, out: &Path) -> Result<()> {
        self.surface.map_or(Ok(()), check_surface_cells)?;
        if !is_folder(out) {
            return Err(Error::InvalidInput(format!(
                "{}: expected a folder for the frames of a surface, as in frames/",
                out.display()
            )));
        }
        check_new_folder(out)
    }

    /// Writes the frames into the folder `out`, and notes what they are; lips were asked for so much `articulation`.
    pub fn write(
        &self,
        (engine, face): (&Engine, &Face),
        (motion, articulation): (&Motion, f32),
        out: &Path,
        report: &mut Report,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let (Some(cells), Motion::Codes(CodeClip { codes, .. })) = (self.surface, motion) else {
            let kind = motion.kind();
            let expected = "surface: expected a system that moves a head (facetalk), got one of";
            return Err(Error::InvalidInput(format!("{expected} {kind}")));
        };
        let (surface, note) = timed(report, "surface", || {
            engine.head_surface(face, cells, progress)
        })?;
        let largest = timed(report, "write", || {
            write_surface_frames(out, &surface, codes.view(), progress)
        })?;
        report.warnings.extend(note);
        let landmarks = engine.landmarks_of(motion)?.displacements;
        report.note_motion(
            Some(largest),
            face.own_motion(landmarks.view()).view(),
            face.metres_per_unit(),
            articulation,
        );
        report.out = Some(shown(out));
        report.frames = motion.frames();
        report.fps = motion.fps();
        report.vertices = Some(surface.vertices());
        Ok(())
    }
}
