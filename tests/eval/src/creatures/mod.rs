//! Measures creatures without a human face whose faces are set up with five clicks: how far their
//! mouths open, and what tears.

mod motion;
mod shapes;

use std::path::{Path, PathBuf};

use anyface::{
    Engine, Face, Result,
    face::{FaceOptions, MouthTrial},
    job::SILENT,
    mesh::{FIVE_POINTS, FixedLandmark, LandmarkPlace, Mesh, Mouth},
};
use clap::Args;
use ndarray::{Array2, Array3, ArrayView2, Axis};
use serde::Serialize;

use self::{
    motion::{of_landmarks, shut_eyes, smile, torn},
    shapes::CREATURES,
};
use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
    gallery::{
        cells::{Cells, View, beside, under},
        file_stem,
        subjects::{self, Subject},
    },
    pictures::{Album, raster::Picture},
    vertex_motion::{distance, spread_landmarks},
};

/// Measure creatures whose faces are set up with five points: how far their mouths open, and what
/// tears
#[derive(Args)]
pub(super) struct Creatures {
    #[command(flatten)]
    data: DataArgs,
    /// Only creatures whose title contains this
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Draw every creature into this folder from two sides: at rest, with dropped jaw, smiling,
    /// with shut eyes
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Write every mesh into this folder, with its five points in the form that --points takes
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
}

/// Files of the data folder, and the five points that somebody clicked on each.
const FILES: [(&str, [[f32; 3]; 5]); 4] = [
    (
        "koala.obj",
        [
            [-0.4886, 2.5349, 4.3788],
            [0.5829, 2.6147, 4.2406],
            [0.0514, 2.0402, 4.9786],
            [-0.2743, 1.6237, 4.4143],
            [0.4971, 1.7666, 4.3382],
        ],
    ),
    (
        "goathead.obj",
        [
            [0.6503, 3.5, -2.95],
            [-0.7509, 3.6, 3.65],
            [-5.1664, 0.9, 0.1],
            [-2.74, -0.1, -1.45],
            [-2.96, -0.3, 2.3],
        ],
    ),
    (
        "cat.obj",
        [
            [-0.6856, 1.1316, -0.3214],
            [-0.7148, 1.1582, 0.0493],
            [-0.9219, 1.1537, -0.1607],
            [-0.9276, 1.0418, -0.2079],
            [-0.9169, 1.0379, -0.0514],
        ],
    ),
    (
        "kaykit_mage.glb",
        [
            [-0.235, 1.62, 0.4137],
            [0.235, 1.62, 0.4138],
            [0.0, 1.49, 0.5141],
            [-0.07, 1.395, 0.4101],
            [0.07, 1.395, 0.41],
        ],
    ),
];

/// The size of a picture in pixels, half its height in metres, and the turn of its second view in
/// radians.
const SIZE: (usize, usize) = (300, 300);
const HALF_HEIGHT_M: f32 = 0.11;
const TURNED: f32 = 0.8;

/// A mouth talks if its lips part by at least this share of the motion of its landmarks. If the
/// lips are one surface, the lower lip has to move down by this share instead.
const LEAST_MOVED: f32 = 0.6;
/// The mouth is painted within this distance of the inner lips' landmarks, in widths of the mouth.
const PAINTED_WIDTHS: f32 = 0.06;
/// A creature talks only if at most this share of the moving triangles is torn or turned over.
const MAX_TORN: f32 = 0.01;

/// One creature.
#[derive(Serialize)]
struct Row {
    title: String,
    /// How the lips meet.
    mouth: &'static str,
    /// For each eye, whether its lids close, are sculpted shut or are joined to the eye.
    lids: [String; 2],
    /// If the lips are one surface: why they could not be opened, or empty if they were.
    sealed: Option<String>,
    /// How far the middles of the lips part when the jaw drops, as a share of the motion of their
    /// landmarks.
    parted: f32,
    /// How far the lower lip moves down, as a share of the motion of its landmark.
    follows: f32,
    /// How far the corners of the mouth move in a smile, as a share of the motion of their
    /// landmarks.
    smile: f32,
    /// Triangles that move when the jaw drops. Of these, how many grow beyond four times their area
    /// and how many turn over.
    moving: usize,
    grown: usize,
    turned: usize,
    /// Sentences about what the mouth cannot show.
    limits: Vec<String>,
    talks: bool,
}

impl Creatures {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let engine = shared.engine()?;
        let mut subjects = subjects_of(&self.data.folder()?.join("meshes"))?;
        if let Some(text) = &self.only {
            subjects.retain(|subject| subject.title.contains(text));
        }
        if let Some(folder) = &self.write {
            subjects.iter().try_for_each(|s| written(folder, s))?;
        }
        let album = self.pictures.clone().map(Album::new).transpose()?;
        let rows = subjects::measured(&subjects, console, |subject| {
            row(&engine, subject, album.as_ref())
        })?;
        let mut lines: Vec<String> = rows.iter().map(line).collect();
        let talking = rows.iter().filter(|row| row.talks).count();
        lines.push(format!("{talking} of {} talk", subjects.len()));
        console.value(&rows, &lines.join("\n"));
        Ok(())
    }
}

/// The meshes of the files and the generated shapes, each with its five points.
fn subjects_of(meshes: &Path) -> Result<Vec<Subject>> {
    let mut subjects = Vec::new();
    for (name, five) in FILES {
        subjects.push(clicked(name, Mesh::read(meshes.join(name))?, &five));
    }
    for creature in &CREATURES {
        subjects.push(clicked(creature.title, creature.mesh()?, &creature.five));
    }
    Ok(subjects)
}

/// A mesh on which somebody clicked five points.
fn clicked(title: &str, mesh: Mesh, five: &[[f32; 3]; 5]) -> Subject {
    let fixed = FIVE_POINTS.into_iter().zip(five);
    let fixed = fixed.map(|(index, point)| FixedLandmark {
        index,
        place: LandmarkPlace::Position(*point),
    });
    Subject {
        title: title.into(),
        mesh,
        options: FaceOptions {
            fixed: fixed.collect(),
            ..FaceOptions::default()
        },
        truth: None,
        tongue: 0..0,
    }
}

fn row(engine: &Engine, subject: &Subject, album: Option<&Album>) -> Result<Row> {
    let mut face = engine.prepare(&subject.mesh, &subject.options, SILENT)?;
    let mouth = face.mouth();
    let mut sealed = None;
    if mouth == Mouth::Welded {
        match engine.open_mouth(&face, SILENT) {
            Ok(opened) => {
                face = engine.prepare(&opened.mesh, &opened.face_options(&face), SILENT)?;
                sealed = Some(String::new());
            }
            Err(why) => {
                sealed = Some(why.to_string());
            }
        }
    }
    let of_pose = |pose: &Array3<f32>| {
        let frames = spread_landmarks(engine, &face, face.motion_on_mesh(pose.view()));
        frames.map(|frames| frames.index_axis_move(Axis(0), 0))
    };
    let (drop, smile) = (MouthTrial::jaw_drop(), smile());
    let (jaw, smiling, shut) = (of_pose(&drop)?, of_pose(&smile)?, of_pose(&shut_eyes())?);
    let [moving, grown, turned] = torn(&face, jaw.view());
    let along = |frame: &Array2<f32>, pose: &Array3<f32>, some: &[usize], less: &[usize]| {
        let pose = pose.index_axis(Axis(0), 0);
        of_landmarks(&face, frame.view(), pose, some, less)
    };
    let parted = along(&jaw, &drop, &[66], &[62]);
    let follows = along(&jaw, &drop, &[57], &[]);
    let moves = match face.mouth() {
        Mouth::Welded => follows,
        Mouth::Open | Mouth::Slit => parted,
    };
    let reach = engine.mouth_reach(&face, SILENT)?;
    let row = Row {
        title: subject.title.clone(),
        mouth: mouth.name(),
        lids: face.lids().map(|lids| format!("{lids:?}").to_lowercase()),
        sealed,
        parted,
        follows,
        smile: along(&smiling, &smile, &[48, 54], &[]),
        moving,
        grown,
        turned,
        limits: reach.iter().flat_map(|reach| reach.sentences()).collect(),
        talks: moves >= LEAST_MOVED && ((grown + turned) as f32) <= MAX_TORN * moving as f32,
    };
    if let Some(album) = album {
        let frames = [
            None,
            Some(jaw.view()),
            Some(smiling.view()),
            Some(shut.view()),
        ];
        album.picture(&file_stem(&subject.title), &picture(&face, &frames))?;
    }
    Ok(row)
}

/// Draws each frame from the front and turned. Lips that are one surface are painted, since nothing
/// else shows them.
fn picture(face: &Face, frames: &[Option<ArrayView2<'_, f32>>]) -> Picture {
    let cells = Cells::new(&face.mesh, face);
    let marks = face.landmarks.positions;
    let near = PAINTED_WIDTHS * distance(marks[48], marks[54]);
    let is_painted = |t: &&[u32; 3]| {
        let corners = t.map(|v| face.mesh.positions[v as usize]);
        let centre = std::array::from_fn(|i| corners.iter().map(|p| p[i]).sum::<f32>() / 3.0);
        (60..68).any(|n| distance(marks[n], centre) < near)
    };
    let painted: Vec<[u32; 3]> = match face.mouth() {
        Mouth::Welded => face
            .mesh
            .triangles
            .iter()
            .filter(is_painted)
            .copied()
            .collect(),
        Mouth::Open | Mouth::Slit => Vec::new(),
    };
    let front = View::about(face, 27..68, SIZE, HALF_HEIGHT_M);
    let rows = [front, front.turned(face, 27..68, TURNED)].map(|view| {
        let row = frames
            .iter()
            .map(|frame| cells.marked(*frame, &painted, &view));
        beside(&row.collect::<Vec<_>>())
    });
    under(&rows)
}

/// Writes the mesh as a Wavefront file, and its points as a text file next to it.
fn written(folder: &Path, subject: &Subject) -> Result<()> {
    use std::{fmt::Write, fs};
    let mut text = String::new();
    for [x, y, z] in &subject.mesh.positions {
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for t in &subject.mesh.triangles {
        let [a, b, c] = t.map(|v| v + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    let points = subject.options.fixed.iter().map(|f| match f.place {
        LandmarkPlace::Position([x, y, z]) => format!("{x},{y},{z}"),
        LandmarkPlace::Vertex(v) => v.to_string(),
    });
    let points = points.collect::<Vec<_>>().join(" ");
    fs::create_dir_all(folder).map_err(anyface::Error::io(folder))?;
    let path = folder.join(file_stem(&subject.title));
    for (ending, text) in [("obj", &text), ("txt", &points)] {
        let path = path.with_extension(ending);
        fs::write(&path, text).map_err(anyface::Error::io(&path))?;
    }
    Ok(())
}

fn line(row: &Row) -> String {
    let lips = match row.sealed.as_deref() {
        None => row.mouth,
        Some("") => "opened",
        Some(_) => "sealed",
    };
    let mut line = format!(
        "{:>22} {lips:>6} {:>13}  parted {:5.2}  follows {:5.2}  smile {:5.2}  moving {:5}  grown {:3}  turned {:3}  {}",
        row.title,
        row.lids.join(" "),
        row.parted,
        row.follows,
        row.smile,
        row.moving,
        row.grown,
        row.turned,
        if row.talks { "talks" } else { "does not talk" }
    );
    let sealed = row.sealed.iter().filter(|why| !why.is_empty());
    for said in sealed.chain(&row.limits) {
        line += &format!("\n{:>25} {said}", "-");
    }
    line
}

#[cfg(test)]
mod tests {
    use anyface::{CachePolicy, EngineOptions};

    use super::*;

    /// The five points of each creature lie on its surface, where somebody can click them.
    #[test]
    fn creatures_are_whole_and_their_points_lie_on_them() {
        for creature in &CREATURES {
            let mesh = creature.mesh().unwrap();
            let nearest = |p: &[f32; 3]| {
                let each = mesh.positions.iter().map(|q| distance(*p, *q));
                each.fold(f32::INFINITY, f32::min)
            };
            for (k, point) in creature.five.iter().enumerate() {
                let far = nearest(point);
                assert!(far < 0.012, "{}, point {k}: {far} m away", creature.title);
            }
        }
    }

    /// The cup's surface has no mouth. Only the points say where it is.
    #[test]
    fn a_cup_talks_by_five_points() {
        let cup = CREATURES
            .iter()
            .find(|c| c.title.starts_with("cup"))
            .unwrap();
        let engine = Engine::new(EngineOptions {
            cache: CachePolicy::Off,
            ..EngineOptions::default()
        });
        let subject = clicked(cup.title, cup.mesh().unwrap(), &cup.five);
        let row = row(&engine.unwrap(), &subject, None).unwrap();
        assert_eq!(row.sealed.as_deref(), Some(""), "{}", line(&row));
        assert!(row.talks && row.parted > 0.9, "{}", line(&row));
    }
}
