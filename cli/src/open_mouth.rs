//! `anyface open-mouth`: lips that are one surface, parted.

use std::path::{Path, PathBuf};

use anyface::{
    Error, Face, Result,
    face::{FaceOptions, OpenedMouth, open_mouth},
    job::{InputKind, read_file},
    mesh::{LandmarkSource, Mesh},
    output::write_opened_obj,
};
use clap::Args;

use crate::{
    arguments::{FaceArgs, SharedArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    stages::{new_report, note_face, timed},
};

/// Part lips that are one surface, and sew the inside of a mouth behind them
#[derive(Args)]
pub struct OpenMouth {
    /// The mesh: OBJ, PLY or GLB
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// The new mesh, .obj: the old vertices keep their numbers and places; texture coordinates,
    /// normals, materials and groups of an OBJ stay
    #[arg(long, value_name = "O.obj")]
    out: OutputPath,
    #[command(flatten)]
    face: FaceArgs,
}

impl OpenMouth {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        check_name(&self.out)?;
        let options = self.face.options(&self.mesh, None)?;
        let mut report = new_report();
        let mesh = timed(&mut report, "read", || Mesh::read(&self.mesh))?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        let face = timed(&mut report, "landmarks", || {
            engine.find(&mesh, &options, &|p| console.progress(p))
        })?;
        let opened = timed(&mut report, "open", || open_mouth(&mesh, &face.landmarks))?;
        timed(&mut report, "write", || {
            write(&self.out, &self.mesh, &mesh, &opened)
        })?;
        note_face(&mut report, &face);
        report.warnings.clear();
        report.mouth = Some("slit".into());
        report.out = Some(shown(&self.out));
        report.vertices = Some(opened.mesh.positions.len());
        let summary = format!(
            "wrote {}: lips parted along {} vertices, {} vertices and {} triangles more",
            self.out.display(),
            opened.upper_rim.len(),
            opened.mesh.positions.len() - mesh.positions.len(),
            opened.mesh.triangles.len() - mesh.triangles.len(),
        );
        console.report(&report, &summary)
    }
}

fn check_name(path: &Path) -> Result<()> {
    match path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("obj"))
    {
        true => Ok(()),
        false => Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .obj",
            path.display()
        ))),
    }
}

/// Writes an opened mesh; `source`: the file that the old one was read from.
pub fn write(out: &Path, source: &Path, old: &Mesh, opened: &OpenedMouth) -> Result<()> {
    let bytes = read_file(source, InputKind::Mesh)?;
    let is_obj = !bytes.starts_with(b"ply") && !bytes.starts_with(b"glTF");
    write_opened_obj(out, is_obj.then_some(bytes.as_slice()), old, opened)
}

/// Where `animate` puts the opened mesh: beside its result.
pub fn beside(result: &Path) -> PathBuf {
    let stem = result.file_stem().unwrap_or_default().to_string_lossy();
    result.with_file_name(format!("{stem}_open_mouth.obj"))
}

/// How the opened mesh is prepared after its face was found.
pub fn options_after(face: &Face, opened: &OpenedMouth) -> FaceOptions {
    let mut options = face.options.clone();
    options.landmarks = Some(LandmarkSource::from(&opened.landmarks));
    options.fixed.clear();
    let names = &mut options.parts.names.of_vertex;
    if !names.is_empty() {
        let new = &opened.vertex_sources[names.len()..];
        let like: Vec<u32> = new.iter().map(|from| names[from[0].0 as usize]).collect();
        names.extend(like);
    }
    options
}
