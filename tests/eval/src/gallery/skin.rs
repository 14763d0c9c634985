//! `anyface-eval skin`: what a template's skin adds to its landmarks, on faces whose true motion is known.

use std::{io::Write, path::PathBuf};

use clap::Args;
use ndarray::{Array1, Array2, Array3, ArrayView2, Axis};
use serde::Serialize;

use super::{
    cells::{Cells, View, beside, under},
    expressions::Expression,
    subjects::{self, Subject, Truth},
};
use crate::{
    arguments::{DataArgs, SharedArgs},
    console::{Console, command_line},
    pictures::{Album, raster::Picture},
};
use anyface::{
    Engine, Error, Face, Result,
    ibug::LANDMARKS,
    mesh::Similarity,
    motion::{LandmarkClip, Motion, TemplateClip},
    nn::Weights,
    output::write_atomically,
    progress::SILENT,
    rig::ARKIT,
    spread::Collector,
    systems::emoface::{EmoFaceConfig, MODEL, ReadTemplate},
};

const CHEEKS: [&str; 3] = ["cheekPuff", "cheekSquintLeft", "cheekSquintRight"];
/// Neither face can show it.
const TONGUE: &str = "tongueOut";
/// Vertices as near to a lip's landmark are lips; those that truly move less do not move. Millimetres.
const LIPS_MM: f32 = 10.0;
const LEAST_MM: f32 = 0.5;
const SIZE: (usize, usize) = (260, 300);
const HALF_HEIGHT_M: f32 = 0.1;
const YAW: f32 = 0.55;

/// Measure what the skin of EmoFace's template adds to its landmarks on faces whose true motion is known, and
/// draw it
#[derive(Args)]
pub(crate) struct Skin {
    #[command(flatten)]
    data: DataArgs,
    /// The page, Markdown, with images/G/ beside it
    #[arg(long, value_name = "G.md")]
    out: PathBuf,
}

/// Errors on one face, mm, by the landmarks and with the skin between them.
#[derive(Serialize)]
struct Scored {
    face: String,
    /// Of each of [`CHEEKS`], the mean over vertices that truly move.
    cheeks: Vec<[f32; 2]>,
    /// Of all other shapes: over vertices that move, over all, and over the lips.
    others: [[f32; 2]; 3],
    /// Shapes that the skin makes worse by more than 0.05 mm over vertices that move.
    worse: Vec<&'static str>,
}

impl Skin {
    pub(crate) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let engine = shared.engine_of(Some(MODEL_SYSTEM))?;
        let data = self.data.folder()?;
        let single: Vec<[(&str, f32); 1]> = ARKIT
            .iter()
            .filter(|name| **name != TONGUE)
            .map(|name| [(*name, 1.0)])
            .collect();
        let shapes: Vec<Expression> = single
            .iter()
            .map(|channels| Expression {
                title: channels[0].0,
                channels,
            })
            .collect();
        let motion = of_template(shared, &data, &shapes)?;
        let known = subjects::of_shapes(&data, &shapes)?;
        let mut scored = Vec::new();
        for subject in &known {
            console.stage("faces", scored.len() as f32 / known.len() as f32);
            scored.push(score(&engine, subject, &motion)?);
        }
        let stem = self.out.file_stem().unwrap_or_default().to_string_lossy();
        let images = format!("images/{stem}");
        let album = Album::new(self.out.with_file_name(&images))?;
        let mut heads = known;
        heads.push(subjects::default_head(
            "rust-core/models/default_head".as_ref(),
        )?);
        heads.extend(subjects::of_folder(&data.join("meshes"))?);
        let mut page = text(&scored);
        for subject in &heads {
            console.stage("pictures", 0.0);
            let Some(picture) = drawn(&engine, subject, &motion, &shapes)? else {
                continue;
            };
            let name = subject.title.replace([' ', ','], "_").to_lowercase();
            let file = album.picture(&name, &picture)?;
            page += &format!("\n{}\n\n![{0}]({images}/{file})\n", subject.title);
        }
        write_atomically(&self.out, |file| file.write_all(page.as_bytes()))?;
        console.value(&scored, &page);
        Ok(())
    }
}

const MODEL_SYSTEM: &str = "emoface";

/// Each of `shapes` as the template of the model shows it, a frame each.
fn of_template(
    shared: &SharedArgs,
    data: &std::path::Path,
    shapes: &[Expression],
) -> Result<TemplateClip> {
    let files = MODEL.open(shared.weights.as_deref())?;
    let config = EmoFaceConfig::from_json(&files.config)?;
    let read = ReadTemplate::load(&Weights::from_bytes(&files.weights)?, &config)?;
    let template = read.template();
    let (mesh, truth) = subjects::ict_mean(data, shapes)?;
    let own = truth.landmarks.map(|v| mesh.positions[v as usize]);
    let fit = Similarity::fit(&own, &template.landmark_positions(), None)?;
    if fit.rms > 1e-5 {
        return Err(Error::InvalidInput(format!(
            "template: expected ICT's face, got one {:.1e} m beside it",
            fit.rms
        )));
    }
    let placed: Vec<_> = mesh
        .positions
        .iter()
        .map(|&p| fit.similarity.apply(p))
        .collect();
    let squared = |p: [f32; 3], q: [f32; 3]| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f32>();
    let nearest = |p: &[f32; 3]| {
        let all = placed.iter().enumerate();
        let nearest = all.min_by(|a, b| squared(*a.1, *p).total_cmp(&squared(*b.1, *p)));
        nearest.map_or(0, |(v, _)| v)
    };
    let vertices: Vec<usize> = template.mesh.positions.iter().map(nearest).collect();
    let moved = truth.displacements.select(Axis(1), &vertices);
    let moved = fit.similarity.displacements_to_canonical(moved.view());
    let mut displacements = Array3::zeros((shapes.len(), LANDMARKS, 3));
    let mut between = Array2::zeros((shapes.len(), template.shapes()));
    for (frame, (landmarks, between)) in moved
        .outer_iter()
        .zip(displacements.outer_iter_mut().zip(between.outer_iter_mut()))
    {
        let values: Vec<f32> = frame.iter().copied().collect();
        read.read(&values, landmarks, between);
    }
    let landmarks = LandmarkClip {
        displacements,
        fps: 1.0,
    };
    TemplateClip::new(template.clone(), landmarks, between)
}

/// `[E, V, 3]`, mesh units: by the landmarks alone, and with the skin between them.
fn both_ways(engine: &Engine, face: &Face, motion: &TemplateClip) -> Result<[Array3<f32>; 2]> {
    let ways = [
        Motion::Landmarks(motion.landmarks.clone()),
        Motion::Template(motion.clone()),
    ];
    let [alone, both] = ways.map(|motion| {
        let made = Collector::collect(|sink| engine.spread(face, &motion, sink, SILENT))?;
        Ok(made.vertices.displacements)
    });
    Ok([alone?, both?])
}

fn score(engine: &Engine, subject: &Subject, motion: &TemplateClip) -> Result<Scored> {
    let truth = subject.truth.as_ref().ok_or_else(|| {
        Error::InvalidInput(format!("{}: expected a truth, got none", subject.title))
    })?;
    let face = engine.prepare(&subject.mesh, &subject.options, SILENT)?;
    let made = both_ways(engine, &face, motion)?;
    let lips = lips(&face, truth.mm);
    let mut scored = Scored {
        face: subject.title.clone(),
        cheeks: Vec::new(),
        others: [[0.0; 2]; 3],
        worse: Vec::new(),
    };
    let names: Vec<&'static str> = ARKIT
        .iter()
        .copied()
        .filter(|name| *name != TONGUE)
        .collect();
    let others = (names.len() - CHEEKS.len()) as f32;
    for (e, name) in names.iter().enumerate() {
        let real = truth.displacements.index_axis(Axis(0), e);
        let of_way = made.each_ref().map(|made| {
            let made = made.index_axis(Axis(0), e);
            errors(truth, real, made, &lips)
        });
        let moving = of_way.map(|errors| errors[0]);
        match CHEEKS.contains(name) {
            true => scored.cheeks.push(moving),
            false => (0..3).for_each(|k| {
                (0..2).for_each(|way| scored.others[k][way] += of_way[way][k] / others);
            }),
        }
        if moving[1] > moving[0] + 0.05 {
            scored.worse.push(name);
        }
    }
    Ok(scored)
}

/// Mean error, mm: over vertices that truly move, over all, and over the lips.
fn errors(
    truth: &Truth,
    real: ArrayView2<'_, f32>,
    made: ArrayView2<'_, f32>,
    lips: &[bool],
) -> [f32; 3] {
    let length = |row: Array1<f32>| truth.mm * row.dot(&row).sqrt();
    let (mut sums, mut counts) = ([0.0f32; 3], [0.0f32; 3]);
    for (v, (real, made)) in real.outer_iter().zip(made.outer_iter()).enumerate() {
        let error = length(&real - &made);
        let counted = [length(real.to_owned()) > LEAST_MM, true, lips[v]];
        for k in (0..3).filter(|&k| counted[k]) {
            sums[k] += error;
            counts[k] += 1.0;
        }
    }
    std::array::from_fn(|k| sums[k] / counts[k].max(1.0))
}

fn lips(face: &Face, mm: f32) -> Vec<bool> {
    let marks = &face.landmarks.positions[48..];
    let near = |p: &[f32; 3]| {
        marks.iter().any(|mark| {
            let squared: f32 = (0..3).map(|i| (p[i] - mark[i]).powi(2)).sum();
            mm * squared.sqrt() < LIPS_MM
        })
    };
    face.mesh.positions.iter().map(near).collect()
}

/// At rest, cheeks puffed by the landmarks, with the skin, and in truth where it is known; and the same squinting.
fn drawn(
    engine: &Engine,
    subject: &Subject,
    motion: &TemplateClip,
    shapes: &[Expression],
) -> Result<Option<Picture>> {
    let face = match engine.prepare(&subject.mesh, &subject.options, SILENT) {
        Ok(face) => face,
        Err(Error::FaceNotFound(_)) => return Ok(None),
        Err(other) => return Err(other),
    };
    let made = both_ways(engine, &face, motion)?;
    let cells = Cells {
        mesh: &subject.mesh,
        face: &face,
    };
    let view = View::about(&face, 17..68, SIZE, HALF_HEIGHT_M).turned(&face, 17..68, YAW);
    let place = |name: &str| {
        shapes
            .iter()
            .position(|shape| shape.title == name)
            .unwrap_or(0)
    };
    let puff = place(CHEEKS[0]);
    let squint = [place(CHEEKS[1]), place(CHEEKS[2])];
    let rows = [vec![puff], squint.to_vec()].map(|frames| {
        let of = |all: &Array3<f32>| all.select(Axis(0), &frames).sum_axis(Axis(0));
        let mut row = vec![cells.close_up(None, &view)];
        let ways = made
            .iter()
            .chain(subject.truth.iter().map(|truth| &truth.displacements));
        for way in ways {
            row.push(cells.close_up(Some(of(way).view()), &view));
        }
        beside(&row)
    });
    Ok(Some(under(&rows)))
}

fn text(scored: &[Scored]) -> String {
    let mut text = format!(
        "# Skin between the landmarks\n\nMade by `{}`. Each of ICT's 51 shapes moves EmoFace's template as it \
         truly does, and reaches a face by the template's 68 landmarks alone (before the arrow) and with what its \
         skin does between them (behind it). Truth is the face's own shape of that name: of the unseen identity \
         that of the same model, of MakeHuman another artist's, which nobody could guess. Mean errors in mm: \
         over vertices that truly move by more than {LEAST_MM} mm; over all; over those within {LIPS_MM} mm of a \
         lip's landmark.\n\n\
         | face | cheekPuff | cheekSquint, left and right | others, moving | all vertices | lips |\n\
         | --- | --- | --- | --- | --- | --- |\n",
        command_line()
    );
    let way = |[alone, both]: [f32; 2]| format!("{alone:.3} → {both:.3}");
    for one in scored {
        text += &format!(
            "| {} | {} | {}, {} | {} | {} | {} |\n",
            one.face,
            way(one.cheeks[0]),
            way(one.cheeks[1]),
            way(one.cheeks[2]),
            way(one.others[0]),
            way(one.others[1]),
            way(one.others[2]),
        );
    }
    text += "\nWorse by more than 0.05 mm over vertices that move: ";
    let worse = scored.iter().map(|one| match one.worse.is_empty() {
        true => format!("{}: none", one.face),
        false => format!("{}: {}", one.face, one.worse.join(", ")),
    });
    text += &worse.collect::<Vec<_>>().join("; ");
    text + ".\n\nPictures: at rest, by the landmarks, with the skin, and in truth where it is known; above cheeks \
            that are puffed, below both that squint.\n"
}
