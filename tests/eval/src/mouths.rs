//! Opens mouths whose lips are one surface, on many heads, and measures the rims of the lips when
//! the jaw drops by 20 mm.

use std::path::PathBuf;

use anyface::{
    Engine, Face, Result,
    face::{MouthTrial, OpenedFace, open_mouth},
    job::SILENT,
    mesh::Mouth,
};
use clap::Args;
use ndarray::{Array3, Axis};
use serde::Serialize;

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
    gallery::{
        cells::{Cells, View, beside, under},
        file_stem,
        subjects::{self, Subject},
    },
    pictures::{Album, raster::Picture},
    vertex_motion::spread_landmarks,
};

/// Measure on many heads how lips that are one surface part once they are cut open
#[derive(Args)]
pub(super) struct Mouths {
    #[command(flatten)]
    data: DataArgs,
    /// Measure the meshes in this folder as well
    #[arg(long, value_name = "DIR")]
    also: Vec<PathBuf>,
    /// Draw every mouth into this folder, at rest and open, from the front and turned
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

/// Width and height of a mouth's picture in pixels, and half of its height in metres.
const SIZE: (usize, usize) = (420, 360);
const HALF_HEIGHT_M: f32 = 0.045;
/// Yaw of the turned view, radians. It shows the mouth bag and stretched skin from the side.
const TURNED: f32 = 0.7;

/// One head.
#[derive(Serialize)]
struct Row {
    title: String,
    /// How its lips meet: the name of a `Mouth`.
    mouth: &'static str,
    /// Why its mouth could not be opened.
    refused: Option<String>,
    trial: Option<Trial>,
}

/// Serialisable copy of [`MouthTrial`], with the number of vertices in the upper rim.
#[derive(Serialize)]
struct Trial {
    parted: f64,
    bend_deg: [f64; 2],
    asymmetry: f64,
    turned: usize,
    rim: usize,
}

impl Mouths {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let engine = shared.engine()?;
        let mut subjects = subjects::of_folder(&self.data.folder()?.join("meshes"))?;
        for folder in &self.also {
            subjects.extend(subjects::of_folder(folder)?);
        }
        let album = self.pictures.clone().map(Album::new).transpose()?;
        let rows = subjects::measured(&subjects, console, |subject| {
            row(&engine, subject, album.as_ref())
        })?;
        let lines: Vec<String> = rows.iter().map(line).collect();
        console.value(&rows, &lines.join("\n"));
        Ok(())
    }
}

fn row(engine: &Engine, subject: &Subject, album: Option<&Album>) -> Result<Row> {
    let face = &engine.find(&subject.mesh, &subject.options, SILENT)?;
    let mut row = Row {
        title: subject.title.clone(),
        mouth: face.mouth().name(),
        refused: None,
        trial: None,
    };
    if face.mouth() != Mouth::Welded {
        return Ok(row);
    }
    row.refused = engine.open_mouth(face, SILENT).err().map(|e| e.to_string());
    let Ok(opened) = open_mouth(&face.mesh, &face.landmarks) else {
        return Ok(row);
    };
    let trial = engine.mouth_trial(face, &opened, SILENT)?;
    let MouthTrial {
        parted,
        bend_deg,
        asymmetry,
        turned,
    } = trial;
    row.trial = Some(Trial {
        parted,
        bend_deg,
        asymmetry,
        turned,
        rim: opened.upper_rim.len(),
    });
    if let Some(album) = album {
        let picture = picture(engine, face, &opened)?;
        album.picture(&file_stem(&subject.title), &picture)?;
    }
    Ok(row)
}

/// Draws the mouth at rest and open, in a row from the front and a row turned below it. The inside
/// of the mouth is red.
fn picture(engine: &Engine, face: &Face, opened: &OpenedFace) -> Result<Picture> {
    let after = engine.prepare(&opened.mesh, &opened.face_options(face), SILENT)?;
    let drop: Array3<f32> = after.motion_on_mesh(MouthTrial::jaw_drop().view());
    let frames = spread_landmarks(engine, &after, drop)?;
    let cells = Cells::new(&opened.mesh, &after);
    let front = View::about(&after, 48..68, SIZE, HALF_HEIGHT_M);
    let views = [front, front.turned(&after, 48..68, TURNED)];
    let open = frames.index_axis(Axis(0), 0);
    let inside = &opened.mesh.triangles[opened.first_inside_triangle..];
    let rows = views.map(|view| {
        beside(&[
            cells.marked(None, inside, &view),
            cells.marked(Some(open), inside, &view),
        ])
    });
    Ok(under(&rows))
}

fn line(row: &Row) -> String {
    let measured = row.trial.as_ref().map_or(String::new(), |trial| {
        format!(
            "rim {:3}  parted {:5.2}  bends {:3.0} {:3.0}  asymmetry {:.2}  turned {}",
            trial.rim,
            trial.parted,
            trial.bend_deg[0],
            trial.bend_deg[1],
            trial.asymmetry,
            trial.turned
        )
    });
    format!(
        "{:>26} {:>6} {measured} {}",
        row.title,
        row.mouth,
        row.refused.as_deref().unwrap_or_default()
    )
}
