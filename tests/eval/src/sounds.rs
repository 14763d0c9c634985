//! Draws the mouth at thirteen kinds of sounds on several heads: what a deaf person reads.

use std::path::PathBuf;

use anyface::{
    Error, MotionRequest, Result,
    annotation::{Interval, Symbols},
    audio::Waveform,
    face::FaceOptions,
    job::SILENT,
    mesh::Mesh,
};
use clap::Args;
use ndarray::Axis;

use crate::{
    arguments::SharedArgs,
    console::Console,
    gallery::{
        cells::{Cells, View, beside, under},
        subjects::{self, Subject},
    },
    pictures::{Album, letters, raster::Picture},
    vertex_motion::vertex_motion,
};

/// Draw the mouth at thirteen kinds of sounds, from the front and in profile
#[derive(Args)]
pub(super) struct Sounds {
    /// The speech
    #[arg(long, value_name = "A")]
    audio: PathBuf,
    /// The words that are spoken; they place the sounds in time, and do not act on the mouth
    #[arg(long, value_name = "W")]
    text: String,
    /// The picture, .png
    #[arg(long, value_name = "P.png")]
    out: PathBuf,
    /// The system that moves the mouth [default: freetalk]
    #[arg(long, value_name = "NAME")]
    system: Option<String>,
    /// Draw these meshes instead of the heads of the seeds 1 to 3
    #[arg(long = "mesh", value_name = "M")]
    meshes: Vec<PathBuf>,
}

/// The kinds of sounds, and the recogniser's signs of each.
const KINDS: [(&str, &[&str]); 13] = [
    ("p b m", &["p", "b", "m"]),
    ("f v", &["f", "v"]),
    ("th", &["θ", "ð"]),
    ("t d n", &["t", "d", "n"]),
    ("s z", &["s", "z"]),
    ("sh", &["ʃ", "ʒ"]),
    ("l", &["l"]),
    ("r", &["ɹ", "ɝ"]),
    ("k g", &["k", "ɡ"]),
    ("oo w", &["u", "w"]),
    ("oh", &["o", "ɔ"]),
    ("ee", &["i"]),
    ("ah", &["ɑ", "a", "æ"]),
];
const FPS: f64 = 60.0;
const SIZE: (usize, usize) = (150, 118);
const HALF_HEIGHT_M: f32 = 0.033;
/// Turn of the profile, radians.
const PROFILE: f32 = 1.35;

impl Sounds {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let engine = shared.engine_of(self.system.as_deref())?;
        let waveform = Waveform::from_file(&self.audio)?;
        let said = engine.listen_to_phones(&waveform, Some(&self.text))?;
        let phones = said.intervals(Symbols::Phones);
        let mut request = MotionRequest {
            fps: FPS,
            ..MotionRequest::default()
        };
        request.controls.set("blinks_per_minute", 0.0);
        let performance = engine.perform(&waveform, &request, SILENT)?;
        let last = performance.motion.frames().saturating_sub(1);
        let frames = KINDS.map(|(_, signs)| middle(phones, signs).map(|t| t.min(last)));
        let heads = self.heads(shared)?;
        let rows = subjects::measured(&heads, console, |head| {
            let face = engine.prepare(&head.mesh, &head.options, SILENT)?;
            let moved = vertex_motion(&engine, &face, &performance)?;
            let cells = Cells {
                mesh: &head.mesh,
                face: &face,
                tongue: head.tongue.clone(),
            };
            let front = View::about(&face, 48..68, SIZE, HALF_HEIGHT_M);
            let draw = |view: View| {
                let cell = |frame: &Option<usize>| match frame {
                    Some(t) => cells.close_up(Some(moved.index_axis(Axis(0), *t)), &view),
                    None => Picture::white(SIZE.0, SIZE.1),
                };
                beside(&frames.iter().map(cell).collect::<Vec<_>>())
            };
            Ok(under(&[
                draw(front),
                draw(front.turned(&face, 48..68, PROFILE)),
            ]))
        })?;
        let whole = under(&[vec![titles()], rows].concat());
        let folder = self.out.parent().unwrap_or(&self.out).to_path_buf();
        let stem = self.out.file_stem().unwrap_or_default().to_string_lossy();
        let name = Album::new(folder)?.picture(&stem, &whole)?;
        let missing: Vec<&str> = KINDS
            .iter()
            .zip(&frames)
            .filter(|(_, t)| t.is_none())
            .map(|((name, _), _)| *name)
            .collect();
        if !missing.is_empty() {
            let missing = missing.join(", ");
            return Err(Error::InvalidInput(format!(
                "text: expected all kinds of sounds to be heard in it, not heard: {missing}"
            )));
        }
        console.value(&name, &name);
        Ok(())
    }

    fn heads(&self, shared: &SharedArgs) -> Result<Vec<Subject>> {
        if self.meshes.is_empty() {
            return subjects::of_seeds(shared.weights.as_deref(), 3);
        }
        let head = |path: &PathBuf| {
            Ok(Subject {
                title: path.display().to_string(),
                mesh: Mesh::read(path)?,
                options: FaceOptions::default(),
                truth: None,
                tongue: 0..0,
            })
        };
        self.meshes.iter().map(head).collect()
    }
}

/// The frame in the middle of the longest of these phones.
fn middle(phones: &[Interval], signs: &[&str]) -> Option<usize> {
    let named = phones
        .iter()
        .filter(|phone| signs.contains(&phone.label.as_str()));
    let length = |phone: &&Interval| phone.end_s - phone.start_s;
    let longest = named.max_by(|a, b| length(a).total_cmp(&length(b)))?;
    Some((0.5 * (longest.start_s + longest.end_s) * FPS).round() as usize)
}

/// The names of the kinds above their columns.
fn titles() -> Picture {
    let cells = KINDS.map(|(name, _)| {
        let mut cell = Picture::white(SIZE.0, letters::LINE + 6);
        letters::write(
            &mut cell,
            name,
            SIZE.0.saturating_sub(letters::width(name)) / 2,
            3,
        );
        cell
    });
    beside(&cells)
}
