//! `anyface landmarks`: finds the 68 landmarks of a mesh.

use std::io::Write;

use anyface::{Result, job::write_atomically, mesh::NamedMesh};
use clap::Args;

use crate::{
    arguments::{FaceArgs, SharedArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    stages::{new_report, note_face, timed},
};

/// Find the 68 landmarks of a mesh
#[derive(Args)]
pub struct FindLandmarks {
    /// The mesh: OBJ, PLY, GLB, VRM or glTF
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// The result as JSON: position, vertex and confidence of each landmark, and how the lips meet
    #[arg(long, value_name = "L.json")]
    out: OutputPath,
    #[command(flatten)]
    face: FaceArgs,
}

impl FindLandmarks {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let mut report = new_report();
        let named = timed(&mut report, "read", || NamedMesh::read(&self.mesh))?;
        let mesh = &named.mesh;
        let file = (&*self.mesh, &named);
        let options = self.face.options(file, None, &mut report.warnings)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        let face = timed(&mut report, "landmarks", || {
            engine.find(mesh, &options, &|p| console.progress(p))
        })?;
        let mouth = face.mouth();
        let json = face.landmarks.to_json_of(mesh, Some(mouth));
        write_atomically(&self.out, |file| file.write_all(json.as_bytes()))?;
        note_face(&mut report, &face);
        report.out = Some(shown(&self.out));
        report.vertices = Some(mesh.positions.len());
        let [least, mean] = report.landmark_confidence.unwrap_or_default();
        let summary = format!(
            "wrote {}: 68 landmarks, confidence {mean:.2} on average, {least:.2} at least; {}",
            self.out.display(),
            mouth.sentence()
        );
        console.report(&report, &summary)
    }
}
