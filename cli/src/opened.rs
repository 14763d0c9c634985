//! `anyface open-mouth` and `anyface open-eyes`: cut apart lips, or lids and eyes, that are one surface.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use anyface::{
    Error, Result,
    face::OpenedFace,
    job::{Progress, write_atomically},
    mesh::{Mesh, Mouth, NamedMesh, read_mesh_file},
    output::write_opened_obj,
};
use clap::Args;

use crate::{
    arguments::{FaceArgs, SharedArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath, landmarks_beside},
    stages::{new_report, note_face, timed},
};

/// Which mesh is cut, and where the new one goes
#[derive(Args)]
pub struct Open {
    /// The mesh: OBJ, PLY, GLB, VRM or glTF
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// The new mesh, .obj. The old vertices keep their numbers and places. An OBJ keeps its texture coordinates, normals,
    /// materials and groups. The landmarks are written beside it, to O.landmarks.json, where every command finds them
    #[arg(long, value_name = "O.obj")]
    out: OutputPath,
    #[command(flatten)]
    face: FaceArgs,
}

/// The feature that is cut open.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// Lips that are one surface.
    Mouth,
    /// Eyes that are one surface with their lids.
    Eyes,
}

impl Open {
    /// The landmarks file of the new mesh.
    pub fn outputs_beside(&self) -> Vec<PathBuf> {
        vec![landmarks_beside(&self.out)]
    }

    pub fn run(&self, feature: Feature, shared: &SharedArgs, console: &Console) -> Result<()> {
        check_name(&self.out)?;
        let mut report = new_report();
        let named = timed(&mut report, "read", || NamedMesh::read(&self.mesh))?;
        let mesh = &named.mesh;
        let file = (&*self.mesh, &named);
        let mut warnings = Vec::new();
        let options = self.face.options(file, None, &mut warnings)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        let face = timed(&mut report, "landmarks", || {
            engine.find(mesh, &options, &|p| console.progress(p))
        })?;
        let progress = |p: Progress| console.progress(p);
        let opened = timed(&mut report, "open", || match feature {
            Feature::Mouth => engine.open_mouth(&face, &progress),
            Feature::Eyes => engine.open_eyes(&face, &progress),
        })?;
        let mouth = match feature {
            Feature::Mouth => Mouth::Slit,
            Feature::Eyes => face.mouth(),
        };
        timed(&mut report, "write", || {
            write(&self.out, &self.mesh, mesh, &opened, mouth)
        })?;
        note_face(&mut report, &face);
        report.warnings = warnings;
        report.mouth = Some(mouth.name().into());
        report.out = Some(shown(&self.out));
        report.vertices = Some(opened.mesh.positions.len());
        let what = match feature {
            Feature::Mouth => format!("lips parted along {} vertices", opened.upper_rim.len()),
            Feature::Eyes => "eyes cut free of their lids".to_owned(),
        };
        let summary = format!(
            "wrote {}: {what}, {} vertices and {} triangles more",
            self.out.display(),
            opened.mesh.positions.len() - mesh.positions.len(),
            opened.mesh.triangles.len() - mesh.triangles.len(),
        );
        console.report(&report, &summary)
    }
}

fn check_name(path: &Path) -> Result<()> {
    if path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("obj"))
    {
        Ok(())
    } else {
        Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .obj",
            path.display()
        )))
    }
}

/// Writes an opened mesh, and its landmarks beside it. `source` is the file of the old mesh. `mouth` says how
/// the lips of the new mesh meet.
pub fn write(
    out: &Path,
    source: &Path,
    old: &Mesh,
    opened: &OpenedFace,
    mouth: Mouth,
) -> Result<()> {
    let bytes = read_mesh_file(source)?;
    let is_obj = !bytes.starts_with(b"ply") && !bytes.starts_with(b"glTF");
    write_opened_obj(out, is_obj.then_some(bytes.as_slice()), old, opened)?;
    let json = opened.landmarks.to_json_of(&Mesh::read(out)?, Some(mouth));
    write_atomically(&landmarks_beside(out), |file| {
        file.write_all(json.as_bytes())
    })?;
    Ok(())
}

/// The path at which `animate` writes the opened mesh, beside its result.
pub fn beside(result: &Path) -> PathBuf {
    let stem = result.file_stem().unwrap_or_default().to_string_lossy();
    result.with_file_name(format!("{stem}_open_mouth.obj"))
}
