//! `anyface rig`: ARKit shapes and visemes for any head.

use std::{ffi::OsStr, path::PathBuf};

use anyface::{
    Error, Result,
    face::ShapeReport,
    job::write_json,
    mesh::{NamedMesh, read_mesh_file},
    output::{Report, ShapedObject, write_avatar, write_rig, write_rig_folder, write_rig_glb},
    rig::{ARKIT, ShapeSource, VISEMES},
};
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::{
    arguments::{FaceArgs, SharedArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath, is_folder},
    stages::{new_report, note_face, timed},
};

/// The source of the displacements of each shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum By {
    /// The landmarks of a mean face, corrected by a network
    Network,
    /// The deformation field of the FaceTalk head that resembles the mesh
    Field,
}

/// Make the 52 ARKit shapes and 15 visemes of a head
#[derive(Args)]
pub struct MakeRig {
    /// The mesh: OBJ, PLY, GLB, VRM or glTF
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// The result: .glb (the mesh with its shapes as morph targets, and everything else of the mesh's GLB or VRM, such as
    /// bones, materials and animations), .npz (names, deltas [S, V, 3], neutral), .vrm (an avatar with the expressions of
    /// VRM and the 52 of Perfect Sync), or a folder with one OBJ for each shape. A VRM keeps everything else of the mesh's
    /// VRM
    #[arg(long, value_name = "R")]
    out: OutputPath,
    /// What moves the skin in each shape: a network, or the field of a head that resembles the mesh
    #[arg(long, value_enum, default_value_t = By::Network)]
    by: By,
    /// Also make each ARKit shape at half its weight, as NAME_half, which need not lie halfway (--by field)
    #[arg(long)]
    in_betweens: bool,
    /// Also write a report of every shape
    #[arg(long, value_name = "R.json")]
    report: Option<OutputPath>,
    #[command(flatten)]
    face: FaceArgs,
}

/// The report of a run, and one for each shape.
#[derive(Serialize)]
struct RigReport<'a> {
    #[serde(flatten)]
    run: &'a Report,
    shapes: &'a [ShapeReport],
    /// The objects of a GLB that have shapes now.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    objects: &'a [ShapedObject],
}

impl MakeRig {
    /// All files of a folder of shapes.
    pub fn outputs_beside(&self) -> Vec<PathBuf> {
        if !is_folder(&self.out) {
            return Vec::new();
        }
        let shapes = ARKIT.iter().chain(&VISEMES).copied();
        let names = shapes.chain(["neutral"]).map(str::to_owned);
        let halves = ARKIT.iter().filter(|_| self.in_betweens);
        let halves = halves.map(|name| format!("{name}_half"));
        names
            .chain(halves)
            .map(|name| self.out.join(format!("{name}.obj")))
            .collect()
    }

    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let form = self.form()?;
        if self.in_betweens && self.by == By::Network {
            return Err(Error::InvalidInput(
                "--in-betweens: expected --by field, got shapes by the network, which move on straight lines"
                    .to_owned(),
            ));
        }
        let mut report = new_report();
        let named = timed(&mut report, "read", || NamedMesh::read(&self.mesh))?;
        let mesh = &named.mesh;
        let file = (&*self.mesh, &named);
        let options = self.face.options(file, None, &mut report.warnings)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        let (face, rig) = timed(&mut report, "shapes", || {
            let progress = |p| console.progress(p);
            let face = engine.find(mesh, &options, &progress)?;
            let in_betweens = self.in_betweens;
            let source = match self.by {
                By::Network => ShapeSource::Network,
                By::Field => ShapeSource::Field { in_betweens },
            };
            let rig = engine.rig(&face, source, &progress)?;
            Ok((face, rig))
        })?;
        note_face(&mut report, &face);
        let mut objects = Vec::new();
        let replaced = timed(&mut report, "write", || {
            let bytes = || read_mesh_file(&self.mesh);
            match form {
                Form::Archive => write_rig(&self.out, &rig, mesh)?,
                Form::Scene => {
                    let landmarked_mesh = (mesh, &face.landmarks);
                    objects = write_rig_glb(&self.out, &rig, landmarked_mesh, Some(&bytes()?))?;
                }
                Form::Avatar => {
                    let landmarked_mesh = (mesh, &face.landmarks);
                    return write_avatar(&self.out, &rig, landmarked_mesh, Some(&bytes()?));
                }
                Form::Folder => {
                    let source = Some(bytes()?).filter(|bytes| is_obj(bytes));
                    write_rig_folder(&self.out, &rig, mesh, source.as_deref())?;
                }
            }
            Ok(Vec::new())
        })?;
        let replaced = (!replaced.is_empty()).then(|| {
            format!(
                "the file had expressions of these names, which are new now: {}",
                replaced.join(", ")
            )
        });
        report.warnings.extend(replaced.clone());
        report.out = Some(shown(&self.out));
        report.vertices = Some(mesh.positions.len());
        note_shapes(&mut report, &rig.reports);
        let full = RigReport {
            run: &report,
            shapes: &rig.reports,
            objects: &objects,
        };
        if let Some(path) = &self.report {
            write_json(path, &full)?;
        }
        let replaced = replaced.map(|sentence| format!("warning: {sentence}\n"));
        let text = summary(&report, &rig.reports) + &objects_text(&objects);
        let text = text + &replaced.unwrap_or_default();
        console.value(&full, &text)
    }

    fn form(&self) -> Result<Form> {
        match self.out.extension().and_then(OsStr::to_str) {
            Some("npz") => Ok(Form::Archive),
            Some("glb") => Ok(Form::Scene),
            Some("vrm") => Ok(Form::Avatar),
            _ if is_folder(&self.out) => Ok(Form::Folder),
            other => Err(Error::InvalidInput(format!(
                "{}: expected a name that ends in .glb, .npz or .vrm, or a folder, got .{}",
                self.out.display(),
                other.unwrap_or_default()
            ))),
        }
    }
}

/// The format of the result.
#[derive(Debug, Clone, Copy)]
enum Form {
    Archive,
    Scene,
    Avatar,
    Folder,
}

fn is_obj(bytes: &[u8]) -> bool {
    !bytes.starts_with(b"ply") && !bytes.starts_with(b"glTF")
}

fn note_shapes(report: &mut Report, shapes: &[ShapeReport]) {
    report.largest_displacement_mm = shapes.iter().map(|s| s.largest_mm).reduce(f32::max);
    for shape in shapes.iter().filter(|shape| shape.name != "viseme_sil") {
        if let Some(note) = &shape.note {
            report.warnings.push(format!("{}: {note}", shape.name));
        }
    }
}

/// A line for each object that has shapes.
fn objects_text(objects: &[ShapedObject]) -> String {
    let line = |object: &ShapedObject| {
        let kept = match object.kept {
            0 => String::new(),
            kept => format!(", kept {kept}"),
        };
        format!("{:>20} got {} shapes{kept}\n", object.name, object.new)
    };
    objects.iter().map(line).collect()
}

/// The summary for people: the total, then a table of the shapes and their notes.
fn summary(report: &Report, shapes: &[ShapeReport]) -> String {
    let present = shapes.iter().filter(|shape| shape.present).count();
    let total: f64 = report.seconds.values().sum();
    let mut text = format!(
        "wrote {}: {present} of {} shapes move, in {total:.2} s\n",
        report.out.as_deref().unwrap_or("nothing"),
        shapes.len()
    );
    for shape in shapes {
        let note = shape
            .note
            .as_deref()
            .map_or(String::new(), |note| format!("  {note}"));
        text += &format!("{:>20} {:6.1} mm{note}\n", shape.name, shape.largest_mm);
    }
    text
}
