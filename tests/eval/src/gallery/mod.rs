//! `anyface-eval gallery`: makes a page that shows every mesh with its landmarks, four frames and
//! an error map.

pub(crate) mod blinks;
pub(crate) mod cells;
mod creases;
mod expressions;
mod mouths;
pub(crate) mod subjects;

use std::path::PathBuf;

use clap::Args;
use ndarray::{Array2, Array3, Axis, s};
use serde::Serialize;

use self::{
    cells::{Cells, error_mm, stretch},
    expressions::{HEARD_EMOTIONS, MOVEMENTS},
    subjects::{Subject, Truth},
};
use crate::{
    arguments::{DataArgs, SharedArgs},
    console::{Console, command_line, write_page},
    face_model::IctLandmarks,
    pictures::{Album, raster::Picture},
    vertex_motion::{distance, spread_landmarks, vertex_motion},
};
use anyface::{
    Engine, Error, Face, Result,
    job::SILENT,
    mesh::ibug::LANDMARKS,
    motion::{LandmarkClip, Motion},
};

/// Make a page that shows meshes with their landmarks, four frames and an error map
#[derive(Args)]
pub(crate) struct Gallery {
    #[command(flatten)]
    data: DataArgs,
    /// The page as Markdown, with G.json and images/G/ next to it
    #[arg(long, value_name = "G.md")]
    out: PathBuf,
    /// The default head: head.obj and landmarks.json
    #[arg(
        long,
        value_name = "DIR",
        default_value = "weights/shared/default_head"
    )]
    head: PathBuf,
    /// A folder of further meshes, such as heads of characters
    #[arg(long, value_name = "DIR")]
    also: Option<PathBuf>,
}

/// The number of mouth movements, which come first in `MOVEMENTS`.
const MOUTH: usize = 3;

/// What the page says about a mesh.
#[derive(Default, Serialize)]
struct Shown {
    title: String,
    vertices: usize,
    /// Mean over the landmarks. `None` if no face was found.
    confidence: Option<f32>,
    /// Why there is no face.
    refused: Option<String>,
    /// Median distance of the face's landmarks from the true ones, in millimetres on a human head.
    landmarks_mm: Option<f32>,
    /// The mean error of each expression over all vertices that truly move.
    error_mm: Option<Vec<f32>>,
    /// Share of triangles whose area grows or shrinks by more than a factor of three in any frame.
    torn_share: Option<f32>,
    picture: Option<String>,
}

impl Gallery {
    pub(crate) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let engine = shared.engine()?;
        let data = self.data.folder()?;
        let motion = motion(&IctLandmarks::read(&data)?)?;
        let stem = self.out.file_stem().unwrap_or_default().to_string_lossy();
        let images = format!("images/{stem}");
        let album = Album::new(self.out.with_file_name(&images))?;
        let mut subjects = vec![subjects::default_head(&self.head)?];
        subjects.extend(subjects::of_known_faces(&data)?);
        subjects.extend(subjects::of_folder(&data.join("meshes"))?);
        if let Some(folder) = &self.also {
            subjects.extend(subjects::of_folder(folder)?);
        }
        let count = subjects.len() as f32;
        let mut shown = Vec::new();
        for (k, subject) in subjects.iter().enumerate() {
            console.stage("meshes", k as f32 / count);
            shown.push(show(&engine, &album, subject, &motion)?);
        }
        let scene = Scenes {
            engine: &engine,
            album: &album,
            images: &images,
        };
        console.stage("close-ups", 0.0);
        let page = page(&shown, &images)
            + &scene.blinks(&subjects)?
            + &scene.creases(&subjects::with_emotions(&data)?)?
            + &scene.mouths(&subjects, &motion)?;
        write_page(&self.out, &page, &shown)?;
        console.value(&shown, &page);
        Ok(())
    }
}

/// `[E, 68, 3]` canonical metres: ICT's landmarks in each expression.
fn motion(ict: &IctLandmarks) -> Result<LandmarkClip> {
    let mut displacements = Array3::zeros((MOVEMENTS.len(), LANDMARKS, 3));
    for (e, expression) in MOVEMENTS.iter().enumerate() {
        for (channel, weight) in expression.channels {
            let mode: Array2<f32> = ict.mode(channel)?.mapv(|x| x as f32);
            displacements
                .index_axis_mut(Axis(0), e)
                .scaled_add(*weight, &mode);
        }
    }
    Ok(LandmarkClip {
        displacements,
        fps: 1.0,
    })
}

fn show(engine: &Engine, album: &Album, subject: &Subject, motion: &LandmarkClip) -> Result<Shown> {
    let mut shown = Shown {
        title: subject.title.clone(),
        vertices: subject.mesh.positions.len(),
        ..Shown::default()
    };
    let face = match engine.prepare(&subject.mesh, &subject.options, SILENT) {
        Ok(face) => face,
        Err(Error::FaceNotFound(why)) => {
            shown.refused = Some(why);
            return Ok(shown);
        }
        Err(other) => return Err(other),
    };
    shown.confidence = Some(face.landmarks.confidence.iter().sum::<f32>() / LANDMARKS as f32);
    let moved = frames(engine, subject, &face, motion)?;
    let stretch = stretch(&subject.mesh, moved.view());
    let torn = stretch.iter().filter(|s| **s > 3f32.ln()).count();
    shown.torn_share = Some(torn as f32 / stretch.len().max(1) as f32);
    let (map, scale) = match &subject.truth {
        Some(truth) => {
            shown.landmarks_mm = Some(landmark_error(subject, &face, truth));
            let errors = error_mm(truth, moved.view());
            shown.error_mm = Some(errors.means);
            (errors.worst_of_vertex, 3.0)
        }
        None => (cells::at_vertices(&subject.mesh, &stretch), 3f32.ln()),
    };
    let cells = Cells::new(&subject.mesh, &face);
    let row = cells.row(moved.view(), &map, scale);
    shown.picture = Some(album.picture(&file_stem(&subject.title), &row)?);
    Ok(shown)
}

/// `[E, V, 3]`, mesh units. A face with known true motion follows its own landmarks, any other face
/// ICT's.
fn frames(
    engine: &Engine,
    subject: &Subject,
    face: &Face,
    motion: &LandmarkClip,
) -> Result<Array3<f32>> {
    match &subject.truth {
        Some(truth) => spread_landmarks(engine, face, truth.of_landmarks()),
        None => vertex_motion(engine, face, &Motion::Landmarks(motion.clone())),
    }
}

/// Median distance of the landmarks from the true ones, millimetres.
fn landmark_error(subject: &Subject, face: &Face, truth: &Truth) -> f32 {
    let mut distances: Vec<f32> = (0..LANDMARKS)
        .map(|n| {
            let exact = subject.mesh.positions[truth.landmarks[n] as usize];
            let position = face.landmarks.positions[n];
            truth.mm * distance(exact, position)
        })
        .collect();
    distances.sort_by(f32::total_cmp);
    distances[LANDMARKS / 2]
}

fn page(shown: &[Shown], images: &str) -> String {
    let titles: Vec<&str> = MOVEMENTS.iter().map(|e| e.title).collect();
    let mut text = format!(
        "# Meshes\n\nMade by `{}`. Each row: the landmarks; {}; and a map. Where true motion is known \
         the map is the largest error over the four frames, grey at none, red at 3 mm; elsewhere it \
         is how far a triangle's area changes, red at a third or three times. Heads with true motion \
         are led by their own landmarks' true motion, all others by that of ICT's mean face.\n",
        command_line(),
        titles.join(", ")
    );
    for one in shown {
        text += &format!("\n## {}\n{}\n", one.title, sentence(one));
        if let Some(picture) = &one.picture {
            text += &format!("\n![{}]({images}/{picture})\n", one.title);
        }
    }
    text
}

fn sentence(one: &Shown) -> String {
    let mut text = format!("{} vertices", one.vertices);
    if let Some(why) = &one.refused {
        return format!("{text}; no face: {why}.");
    }
    if let Some(confidence) = one.confidence {
        text += &format!(", confidence {confidence:.2}");
    }
    if let Some(mm) = one.landmarks_mm {
        text += &format!(", landmarks off by {mm:.1} mm (median)");
    }
    if let Some(errors) = &one.error_mm {
        let each = MOVEMENTS.iter().zip(errors);
        let each: Vec<String> = each.map(|(e, mm)| format!("{} {mm:.2}", e.title)).collect();
        text += &format!(
            "; mean error in mm over vertices that move by more than 0.5 mm: {}",
            each.join(", ")
        );
    }
    if let Some(share) = one.torn_share {
        text += &format!("; {:.2} % of triangles change threefold", 100.0 * share);
    }
    text + "."
}

pub(crate) fn file_stem(title: &str) -> String {
    title.replace([' ', ','], "_").to_lowercase()
}

/// The sections of close-ups.
struct Scenes<'a> {
    engine: &'a Engine,
    album: &'a Album,
    images: &'a str,
}

impl Scenes<'_> {
    fn section(
        &self,
        kind: &str,
        subject: &Subject,
        text: &str,
        picture: &Picture,
    ) -> Result<String> {
        let title = format!("{kind}, {}", subject.title);
        let file = file_stem(&format!("{kind} {}", subject.title));
        let file = self.album.picture(&file, picture)?;
        Ok(format!(
            "\n## {title}\n{text}\n\n![{title}]({}/{file})\n",
            self.images
        ))
    }

    fn blinks(&self, subjects: &[Subject]) -> Result<String> {
        let mut text = format!(
            "\n# Blinks\n\nOpen, half shut and shut under each emotion at full strength: {}.\n",
            blinks::titles()
        );
        let whole = |s: &&Subject| match s.title.as_str() {
            "default head" | "lee_perry_smith" => true,
            title => s.truth.is_some() && !title.ends_with("found"),
        };
        for subject in subjects.iter().filter(whole) {
            let blinks_shown = blinks::blinks(self.engine, subject)?;
            let in_sight = blinks_shown.in_sight.map(|shares| {
                let each = shares.iter().map(|share| format!("{:.1}", 100.0 * share));
                format!("{} %", each.collect::<Vec<_>>().join(", "))
            });
            let text_of = match in_sight {
                Some(in_sight) => format!("Of the eyeballs in sight when shut: {in_sight}."),
                None => "Its eyes are part of the skin.".into(),
            };
            text += &self.section("Blinks", subject, &text_of, &blinks_shown.picture)?;
        }
        Ok(text)
    }

    fn creases(&self, subjects: &[Subject]) -> Result<String> {
        let titles: Vec<&str> = HEARD_EMOTIONS.iter().map(|e| e.title).collect();
        let mut text = format!(
            "\n# Creases\n\nTruth above, made from its 68 landmarks below: {}.\n",
            titles.join(", ")
        );
        for subject in subjects {
            let Some(creases_shown) = creases::emotions(self.engine, subject)? else {
                continue;
            };
            let each = creases_shown.error_mm.iter().map(|mm| format!("{mm:.2}"));
            let said = format!(
                "Mean error over vertices that move by more than 0.5 mm: {} mm. Normals turn along the true \
                 turn by {:.2} of it between the brows, {:.2} on the cheeks.",
                each.collect::<Vec<_>>().join(", "),
                creases_shown.turned[0],
                creases_shown.turned[1]
            );
            text += &self.section("Creases", subject, &said, &creases_shown.picture)?;
        }
        Ok(text)
    }

    fn mouths(&self, subjects: &[Subject], motion: &LandmarkClip) -> Result<String> {
        let titles: Vec<&str> = MOVEMENTS[..MOUTH].iter().map(|e| e.title).collect();
        let mut text = format!(
            "\n# Lips that are one surface\n\nAt rest, {}; untouched above, with an opened mouth below, from \
             the front and turned.\n",
            titles.join(", ")
        );
        let motion = LandmarkClip {
            displacements: motion.displacements.slice(s![..MOUTH, .., ..]).to_owned(),
            fps: motion.fps,
        };
        for subject in subjects {
            let Some(mouth_shown) = mouths::welded_lips(self.engine, subject, &motion)? else {
                continue;
            };
            let parted = match &mouth_shown.parted {
                Ok(share) => format!("opened, the lips part by {share:.2} of what is asked"),
                Err(why) => format!("not opened: {why}"),
            };
            let said = format!(
                "Untouched, {:.2} % of the mouth's triangles grow beyond twice their area; {parted}.",
                100.0 * mouth_shown.grown
            );
            text += &self.section("Lips", subject, &said, &mouth_shown.picture)?;
        }
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_mesh_is_on_the_page_with_its_reason() {
        let one = Shown {
            title: "blob".into(),
            vertices: 12,
            refused: Some("no view shows a face".into()),
            ..Shown::default()
        };
        let page = page(&[one], "images/x");
        assert!(page.contains("## blob\n12 vertices; no face: no view shows a face."));
        assert!(!page.contains("!["));
    }
}
