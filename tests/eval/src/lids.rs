//! Measures what shut lids do to the skin of many heads: triangles that turn over or grow, and
//! eyeballs that stay in sight.
//!
//! Shapes that artists made by hand turn triangles over too, where skin rolls in at a lid's fold.
//! The last rows count these in the same way. Our motion need not do better than these shapes.

use std::path::PathBuf;

use anyface::{
    Engine, Face, Result,
    job::SILENT,
    mesh::{FrontView, PartRole},
};
use clap::Args;
use ndarray::{Array3, ArrayView2, Axis};
use serde::Serialize;

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
    gallery::{
        blinks::{self, EMOTIONS},
        cells::{Cells, View, beside, under},
        file_stem,
        subjects::{self, Subject},
    },
    pictures::Album,
    vertex_motion::{distance, dot, normal, pose, vertex_motion},
};

/// Measure shut lids on many heads: triangles that turn over or grow, eyeballs that stay in sight
#[derive(Args)]
pub(super) struct Lids {
    #[command(flatten)]
    data: DataArgs,
    /// The default head: head.obj and landmarks.json
    #[arg(
        long,
        value_name = "DIR",
        default_value = "weights/shared/default_head"
    )]
    head: PathBuf,
    /// A folder of further meshes
    #[arg(long, value_name = "DIR")]
    also: Vec<PathBuf>,
    /// Number of heads to make with `anyface head`, from seed 1 on
    #[arg(long = "made", value_name = "N", default_value_t = 12)]
    seeds: u64,
    /// Strength of each emotion
    #[arg(long, value_name = "X", default_value_t = 1.5)]
    strength: f32,
    /// Draw every head into this folder, one column for each emotion, with triangles that turn over
    /// in red
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

/// The size of a picture of both eyes in pixels, and half its height in metres.
const SIZE: (usize, usize) = (520, 240);
const HALF_HEIGHT_M: f32 = 0.032;

/// Only triangles whose centre lies within this distance of an eye's landmark count, in widths of
/// an eye.
const NEAR: f32 = 1.2;
/// Triangles whose normals have less than this share along the front axis are rims.
const LEAST_FRONT: f32 = 0.25;
/// A triangle is visible if nothing lies further than this in front of its centre, metres.
const BEFORE_M: f32 = 3e-4;
/// Side of a cell of the view, metres.
const CELL_M: f32 = 2e-4;
/// Triangles that grow beyond this many times their area are counted.
const MAX_GROWTH: f32 = 4.0;
/// The shares by which an artist's blink shuts the eyes in the three frames of a row.
const CLOSED: [f32; 3] = [0.0, 0.5, 1.0];
/// Triangles with no more than this share of the mean area are slivers.
const LEAST_AREA: f32 = 1e-3;

/// One head.
#[derive(Serialize)]
struct Row {
    title: String,
    lids: [String; 2],
    /// Numbers of triangles that turn over and that grow, for each emotion with eyes open, half
    /// shut and shut.
    turned: Vec<[usize; 3]>,
    grown: Vec<[usize; 3]>,
    /// The largest visible area of the eyeballs with shut lids in any emotion, as a share of that
    /// at rest.
    in_sight: Option<f64>,
}

impl Lids {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let engine = shared.engine()?;
        let mut subjects = vec![subjects::default_head(&self.head)?];
        subjects.extend(subjects::of_seeds(shared.weights.as_deref(), self.seeds)?);
        let data = self.data.folder()?;
        subjects.extend(subjects::of_known_faces(&data)?);
        subjects.extend(subjects::of_folder(&data.join("meshes"))?);
        for folder in &self.also {
            subjects.extend(subjects::of_folder(folder)?);
        }
        let album = self.pictures.clone().map(Album::new).transpose()?;
        let mut rows = subjects::measured(&subjects, console, |subject| {
            self.row(&engine, subject, album.as_ref())
        })?;
        for subject in subjects::with_blink_and_emotions(&data)? {
            rows.push(self.artist_row(&engine, &subject)?);
        }
        let mut lines = vec![format!(
            "open, half shut and shut: {}",
            EMOTIONS.join(" | ")
        )];
        lines.extend(rows.iter().map(line));
        console.value(&rows, &lines.join("\n"));
        Ok(())
    }

    fn row(&self, engine: &Engine, subject: &Subject, album: Option<&Album>) -> Result<Row> {
        let face = engine.prepare(&subject.mesh, &subject.options, SILENT)?;
        let skin = near_eyes(&face);
        let mut row = Row::new(subject.title.clone(), &face);
        let cells = Cells::new(&subject.mesh, &face);
        let view = View::about(&face, 36..48, SIZE, HALF_HEIGHT_M);
        let mut columns = Vec::new();
        for emotion in EMOTIONS {
            let motion = blinks::extremes(&format!("{emotion}:{}", self.strength))?;
            let frames = vertex_motion(engine, &face, &motion)?;
            let changed = row.count(&face, &skin, &frames);
            if album.is_some() {
                let each = frames.outer_iter().zip(&changed);
                let each = each.map(|(frame, of)| cells.marked(Some(frame), &of.0, &view));
                columns.push(under(&each.collect::<Vec<_>>()));
            }
            let in_sight = blinks::eyeball_share(&face, frames.index_axis(Axis(0), 2));
            row.in_sight = row.in_sight.into_iter().chain(in_sight).reduce(f64::max);
        }
        if let Some(album) = album {
            album.picture(&file_stem(&subject.title), &beside(&columns))?;
        }
        Ok(row)
    }

    /// Measures the blink and the emotions of the subject's own artist. The first of its true
    /// frames is the blink.
    fn artist_row(&self, engine: &Engine, subject: &Subject) -> Result<Row> {
        let face = engine.prepare(&subject.mesh, &subject.options, SILENT)?;
        let skin = near_eyes(&face);
        let mut row = Row::new(format!("{}, its artist's shapes", subject.title), &face);
        let truth = subject.truth.iter().map(|truth| &truth.displacements);
        for modes in truth {
            let blink = modes.index_axis(Axis(0), 0);
            for emotion in 0..modes.len_of(Axis(0)) {
                let mut frames = Array3::zeros((CLOSED.len(), face.mesh.positions.len(), 3));
                for (mut frame, closed) in frames.outer_iter_mut().zip(CLOSED) {
                    frame.scaled_add(closed, &blink);
                    if emotion > 0 {
                        frame.scaled_add(self.strength, &modes.index_axis(Axis(0), emotion));
                    }
                }
                row.count(&face, &skin, &frames);
            }
        }
        Ok(row)
    }
}

impl Row {
    fn new(title: String, face: &Face) -> Row {
        Row {
            title,
            lids: face.lids().map(|lids| format!("{lids:?}").to_lowercase()),
            turned: Vec::new(),
            grown: Vec::new(),
            in_sight: None,
        }
    }

    /// Counts the triangles that turn over and grow in the frames `[3, V, 3]` of an emotion, and
    /// returns them.
    fn count(&mut self, face: &Face, skin: &NearEyes, frames: &Array3<f32>) -> [Changed; 3] {
        let changed = std::array::from_fn(|k| skin.changed(face, frames.index_axis(Axis(0), k)));
        self.turned
            .push(std::array::from_fn(|k| changed[k].0.len()));
        self.grown.push(std::array::from_fn(|k| changed[k].1));
        changed
    }
}

fn line(row: &Row) -> String {
    let in_sight = row
        .in_sight
        .map_or("-".into(), |x| format!("{:.1} %", 100.0 * x));
    let of = |counts: &[[usize; 3]]| {
        let each = counts
            .iter()
            .map(|[open, half, shut]| format!("{open} {half} {shut}"));
        each.collect::<Vec<_>>().join(" | ")
    };
    format!(
        "{:>36} {:>13} in sight {in_sight:>7} turned {} grown {}",
        row.title,
        row.lids.join(" "),
        of(&row.turned),
        of(&row.grown)
    )
}

/// The triangles that turn over, and the number of those that grow.
type Changed = (Vec<[u32; 3]>, usize);

/// The triangles of the skin around the eyes.
struct NearEyes {
    /// Triangles near the eyes, without rims and slivers.
    triangles: Vec<[u32; 3]>,
    /// Their normals at rest in the canonical frame, as long as twice the triangles' areas.
    rest: Vec<[f32; 3]>,
}

fn near_eyes(face: &Face) -> NearEyes {
    let places = canonical(face, &face.mesh.positions);
    let marks = face.landmarks.positions.map(|p| face.to_canonical.apply(p));
    let width = 0.5 * (distance(marks[36], marks[39]) + distance(marks[42], marks[45]));
    let at = |t: &[u32; 3]| t.map(|v| places[v as usize]);
    let skin = face.mesh.triangles.iter();
    let skin = skin.filter(|t| face.parts.is(t[0] as usize, PartRole::Skin));
    let areas: Vec<f32> = skin.clone().map(|t| length(normal(at(t)))).collect();
    let least = LEAST_AREA * areas.iter().sum::<f32>() / areas.len().max(1) as f32;
    let triangles = skin.filter(|t| {
        let centre = centre(at(t));
        let is_near = (36..48).any(|n| distance(marks[n], centre) < NEAR * width);
        let rest = normal(at(t));
        is_near && rest[2].abs() > LEAST_FRONT * length(rest) && length(rest) > least
    });
    let triangles: Vec<[u32; 3]> = triangles.copied().collect();
    NearEyes {
        rest: triangles.iter().map(|t| normal(at(t))).collect(),
        triangles,
    }
}

impl NearEyes {
    /// The visible triangles that turn over in a frame `[V, 3]`, and the number of visible ones
    /// that grow.
    fn changed(&self, face: &Face, frame: ArrayView2<'_, f32>) -> Changed {
        let places = canonical(face, &pose(&face.mesh, frame).positions);
        let visible = find_visible(&self.triangles, &places);
        let mut changed = (Vec::new(), 0);
        for (k, t) in self.triangles.iter().enumerate() {
            if visible[k] {
                let now = normal(t.map(|v| places[v as usize]));
                changed
                    .0
                    .extend((dot(now, self.rest[k]) < 0.0).then_some(*t));
                changed.1 += usize::from(length(now) > MAX_GROWTH * length(self.rest[k]));
            }
        }
        changed
    }
}

fn canonical(face: &Face, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
    positions
        .iter()
        .map(|p| face.to_canonical.apply(*p))
        .collect()
}

/// Whether the centre of each triangle is visible from the front.
fn find_visible(triangles: &[[u32; 3]], places: &[[f32; 3]]) -> Vec<bool> {
    let corners = |t: &[u32; 3]| t.map(|v| places[v as usize]);
    let mut bounds = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for p in triangles.iter().flat_map(corners) {
        for i in 0..2 {
            bounds.0[i] = bounds.0[i].min(p[i]);
            bounds.1[i] = bounds.1[i].max(p[i]);
        }
    }
    let mut view = FrontView::new(bounds.0, bounds.1, CELL_M);
    triangles.iter().for_each(|t| view.draw(corners(t), 1));
    let is_visible = |t: &[u32; 3]| {
        let [x, y, z] = centre(corners(t));
        let [column, row] = view.cell_at([x, y]);
        z > view.depth(column, row) - BEFORE_M
    };
    triangles.iter().map(is_visible).collect()
}

fn centre(corners: [[f32; 3]; 3]) -> [f32; 3] {
    std::array::from_fn(|i| corners.iter().map(|p| p[i]).sum::<f32>() / 3.0)
}

fn length(a: [f32; 3]) -> f32 {
    dot(a, a).sqrt()
}
