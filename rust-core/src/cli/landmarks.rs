//! `anyface landmarks`: the 68 landmarks of a mesh.

use std::{io::Write, path::PathBuf};

use clap::Args;

use super::{
    arguments::{FaceArgs, SharedArgs, shown},
    console::Console,
    stages::{new_report, note_landmarks, timed},
};
use crate::{
    Result,
    mesh::{LandmarkFinder, Mesh, locate_landmarks_with},
    output::write_atomically,
};

/// Find the 68 landmarks of a mesh
#[derive(Args)]
pub(super) struct FindLandmarks {
    /// The mesh: OBJ or PLY
    #[arg(long, value_name = "M")]
    mesh: PathBuf,
    /// The result as JSON: position, vertex and confidence of each
    #[arg(long, value_name = "L.json")]
    out: PathBuf,
    #[command(flatten)]
    face: FaceArgs,
}

impl FindLandmarks {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let options = self.face.options(&self.mesh, None)?;
        let mut report = new_report();
        let mesh = timed(&mut report, "read", || Mesh::read(&self.mesh))?;
        let found = timed(&mut report, "landmarks", || {
            let finder = LandmarkFinder::load(shared.weights.as_deref())?;
            locate_landmarks_with(&finder, &mesh, &options)
        })?;
        write_atomically(&self.out, |file| file.write_all(found.to_json().as_bytes()))?;
        note_landmarks(&mut report, &found.confidence);
        report.out = Some(shown(&self.out));
        report.vertices = Some(mesh.positions.len());
        let [least, mean] = report.landmark_confidence.unwrap_or_default();
        let summary = format!(
            "wrote {}: 68 landmarks, confidence {mean:.2} on average, {least:.2} at least",
            self.out.display()
        );
        console.report(&report, &summary);
        Ok(())
    }
}
