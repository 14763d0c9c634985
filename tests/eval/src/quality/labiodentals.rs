//! f and v: whether the lower lip reaches the upper teeth and tucks in under them.
//!
//! Measured on ICT's mean head, which has teeth in the right place. Spreads the motion over its
//! mesh and takes the vertex of the lower lip that is nearest to the teeth.

use std::path::Path;

use ndarray::{Array2, Array3, ArrayView2, Axis};

use super::{
    bootstrap::{estimate, median},
    clip::{Clip, RECORDED, spaced},
    heads::{Head, stacked},
    phone::Phone,
    predictors::{MODEL, Performed},
    row::Row,
};
use crate::{
    face_model::{FaceModel, IctLandmarks},
    vertex_motion::distance,
};
use anyface::{Engine, Result};

/// Vertices of ICT's upper teeth.
const UPPER_TEETH: std::ops::Range<usize> = 17_039..19_247;
/// Vertices of its skin, of the lips inside and outside, and of the mouth socket.
const SKIN: std::ops::Range<usize> = 0..14_062;
/// Limits of the edge of the incisors, centimetres: sideways from the middle, above the lowest of
/// the middle front vertices, behind the foremost vertex of the teeth.
const EDGE_CM: [f32; 3] = [0.35, 0.15, 0.45];
/// A vertex belongs to the lower lip if the lip's roll moves it by more than this share of the
/// roll's largest motion, and if it lies within `LIP_HALF_WIDTH_CM` of the middle.
const ROLLED: f32 = 0.3;
const LIP_HALF_WIDTH_CM: f32 = 0.6;
/// The lip may reach the teeth this long before the sound, seconds.
const LEAD_S: f64 = 0.04;
/// Middle of the lower lip, inside and outside.
const LOWER_LIP: [usize; 2] = [66, 57];
/// The most f and v of one source to measure.
const MOST: usize = 150;
/// Frames to spread over the mesh at once.
const BATCH: usize = 50;
const MM: f64 = 1000.0;
const MM_PER_CM: f64 = 10.0;

/// ICT's head with its lower lip and the edge of its upper incisors.
pub(super) struct Mouth {
    head: Head,
    /// Vertices of the lower lip.
    lip: Vec<usize>,
    /// `[lip]`, rest positions of these vertices, centimetres.
    rest_cm: Vec<[f32; 3]>,
    edge_cm: Vec<[f32; 3]>,
    /// `[68, 3]` metres.
    neutral: Array2<f64>,
}

/// The measurements of one f or v.
struct Record {
    distance_mm: f64,
    tuck_mm: f64,
}

/// Measures the recording and the model on every source with f and v. All languages of espeak-ng
/// count as one source.
pub(super) fn measure(engine: &Engine, mouth: &Mouth, performed: &[Performed]) -> Result<Vec<Row>> {
    let mut out = Vec::new();
    let mut all_frames = Vec::new();
    for source in performed {
        for (name, pairs) in source.with_recording() {
            let frames = || {
                pairs
                    .iter()
                    .flat_map(|&(clip, motion)| mouth.nearest_frames(clip, motion))
            };
            match (name, source.corpus.is_synthetic()) {
                (MODEL, true) => all_frames.extend(frames()),
                (MODEL | RECORDED, false) => {
                    let frames: Vec<_> = frames().collect();
                    out.extend(mouth.score(engine, (&source.corpus.source, name), &frames)?);
                }
                _ => {}
            }
        }
    }
    out.extend(mouth.score(engine, ("all of espeak-ng", MODEL), &all_frames)?);
    Ok(out)
}

impl Mouth {
    pub(super) fn read(engine: &Engine, data: &Path, ict: &IctLandmarks) -> Result<Self> {
        let model = FaceModel::ict(data)?;
        let mut rolled = Array2::zeros(model.neutral.dim());
        model.add("mouthRollLower", 1.0, rolled.view_mut())?;
        let at = |values: &Array2<f32>, v: usize| [0, 1, 2].map(|i| values[[v, i]]);
        let teeth: Vec<[f32; 3]> = UPPER_TEETH.map(|v| at(&model.neutral, v)).collect();
        let lip = lower_lip(SKIN.map(|v| (at(&model.neutral, v), at(&rolled, v))));
        Ok(Mouth {
            head: Head::of_model(engine, "ICT", &model)?,
            rest_cm: lip.iter().map(|v| at(&model.neutral, *v)).collect(),
            lip,
            edge_cm: incisor_edge(&teeth),
            neutral: ict.neutral.clone(),
        })
    }

    /// For every f and v of a clip, the frame in which landmark 66 is nearest to the teeth.
    fn nearest_frames<'a>(&self, clip: &Clip, motion: &'a Array3<f64>) -> Vec<ArrayView2<'a, f64>> {
        let phones = clip.phones.iter().flatten().filter(|p| p.is_labiodental());
        self.nearest_of(phones, clip, motion)
    }

    /// The same for the given phones.
    pub(super) fn nearest_of<'a, 'p>(
        &self,
        phones: impl Iterator<Item = &'p Phone>,
        clip: &Clip,
        motion: &'a Array3<f64>,
    ) -> Vec<ArrayView2<'a, f64>> {
        let edge = |i: usize| {
            let sum: f32 = self.edge_cm.iter().map(|p| p[i]).sum();
            f64::from(sum) / self.edge_cm.len() as f64 / 100.0
        };
        let distance = |t: &usize| -> f64 {
            let along = |i: usize| self.neutral[[66, i]] + motion[[*t, 66, i]] - edge(i);
            (1..3).map(|i| along(i).powi(2)).sum()
        };
        let nearest = phones.filter_map(|phone| {
            let from = ((phone.from_s - LEAD_S) * clip.fps).ceil().max(0.0) as usize;
            let to = ((phone.to_s * clip.fps).floor() as usize + 1).min(clip.frames());
            (from..to).min_by(|a, b| distance(a).total_cmp(&distance(b)))
        });
        nearest.map(|t| motion.index_axis(Axis(0), t)).collect()
    }

    /// Scores one predictor on one source. None without frames.
    fn score(
        &self,
        engine: &Engine,
        (source, predictor): (&str, &str),
        frames: &[ArrayView2<'_, f64>],
    ) -> Result<Option<Row>> {
        let chosen: Vec<_> = spaced(frames, MOST).cloned().collect();
        let records = self.records(engine, &chosen)?;
        let middle = |of: fn(&Record) -> f64| {
            estimate(&records, move |all| median(all.iter().map(|r| of(r))))
        };
        Ok((!records.is_empty()).then(|| {
            Row::default()
                .with("source", "source", 0, source)
                .with("predictor", "predictor", 0, predictor)
                .with("count", "f v", 0, frames.len())
                .with("distance_mm", "distance", 2, middle(|r| r.distance_mm))
                .with("tuck_mm", "tuck", 2, middle(|r| r.tuck_mm))
        }))
    }

    fn records(&self, engine: &Engine, frames: &[ArrayView2<'_, f64>]) -> Result<Vec<Record>> {
        let mut records = Vec::new();
        for batch in frames.chunks(BATCH) {
            let motion = stacked(batch);
            let moved = self.head.moved(engine, &motion)?.select(Axis(1), &self.lip);
            for (t, lip) in moved.outer_iter().enumerate() {
                let back = LOWER_LIP.map(|n| -motion[[t, n, 2]]);
                records.push(Record {
                    distance_mm: MM_PER_CM * self.distance_cm(lip),
                    tuck_mm: MM * 0.5 * (back[0] + back[1]),
                });
            }
        }
        Ok(records)
    }

    /// Median distance from the lower lip to the incisors over frames `[68, 3]` of motion, mm.
    /// `None` without frames.
    pub(super) fn distance_mm(
        &self,
        engine: &Engine,
        frames: &[ArrayView2<'_, f64>],
    ) -> Result<Option<f64>> {
        let records = self.records(engine, frames)?;
        Ok(median(records.iter().map(|record| record.distance_mm)))
    }

    /// Distance from the incisors to the nearest vertex of the lip. `displaced`: `[lip, 3]`
    /// displacements, centimetres.
    fn distance_cm(&self, displaced: ArrayView2<'_, f32>) -> f64 {
        let lip = self.rest_cm.iter().zip(displaced.rows());
        let squares = lip.flat_map(|(rest, moved)| {
            let at: [f32; 3] = std::array::from_fn(|i| rest[i] + moved[i]);
            self.edge_cm
                .iter()
                .map(move |edge| squared_distance(at, *edge))
        });
        f64::from(squares.fold(f32::MAX, f32::min)).sqrt()
    }
}

fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum()
}

/// Finds the vertices of the lower lip. `vertices`: rest position and motion under the lip's roll,
/// centimetres.
fn lower_lip(vertices: impl Iterator<Item = ([f32; 3], [f32; 3])>) -> Vec<usize> {
    let all: Vec<(f32, f32)> = vertices
        .map(|(at, moved)| (at[0].abs(), distance(moved, [0.0; 3])))
        .collect();
    let most = all.iter().map(|(_, moved)| *moved).fold(0.0, f32::max);
    let inside = |(x, moved): &(f32, f32)| *x < LIP_HALF_WIDTH_CM && *moved > ROLLED * most;
    (0..all.len()).filter(|v| inside(&all[*v])).collect()
}

/// The lowest vertices of the middle front teeth.
fn incisor_edge(teeth: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let front = teeth.iter().map(|p| p[2]).fold(f32::MIN, f32::max) - EDGE_CM[2];
    let near = |p: &&[f32; 3]| p[0].abs() < EDGE_CM[0] && p[2] > front;
    let low = teeth
        .iter()
        .filter(near)
        .map(|p| p[1])
        .fold(f32::MAX, f32::min)
        + EDGE_CM[1];
    teeth
        .iter()
        .filter(near)
        .filter(|p| p[1] < low)
        .copied()
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_is_the_lowest_of_the_middle_front() {
        let teeth = [
            [0.1, -3.5, 10.6],
            [0.1, -3.45, 10.7],
            [0.1, -2.0, 10.75],
            [0.1, -3.6, 8.0],
            [2.0, -3.6, 10.7],
        ];
        assert_eq!(incisor_edge(&teeth), teeth[..2]);
    }

    #[test]
    fn the_lip_is_what_rolls_near_the_middle() {
        let vertices = [
            ([0.0; 3], [0.0, 1.0, 0.0]),
            ([0.0; 3], [0.0, 0.1, 0.0]),
            ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ];
        assert_eq!(lower_lip(vertices.into_iter()), [0]);
    }
}
