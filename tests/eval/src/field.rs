//! Measures how well the field of FaceTalk's head moves the vertices of unseen heads, compared with
//! the decoder of landmarks.
//!
//! The heads are complete ICT heads with random identity coefficients. The poses are ARKit weights:
//! single shapes, and frames of held-out clips of grid_s1. ICT's own modes are the truth.

use std::{path::Path, sync::Arc, time::Instant};

use clap::Args;
use ndarray::{Array2, Array3, Axis};

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
    face_model::FaceModel,
    quality::grid::{TRACK, every_tenth, spans},
    tensors::TensorFile,
    vertex_motion::{distance, spread_landmarks},
};
use anyface::{
    Engine, Error, Face, Result,
    cache::{Cache, CachePolicy},
    face::{CodeField, Rig},
    head::{Head, HeadOnMesh, Reach},
    job::SILENT,
    mesh::Mesh,
    rig::ShapeSource,
};

const MM_PER_CM: f32 = 10.0;
/// Vertices of ICT's face. They come before those of the head and neck, sockets, teeth and eyes.
pub(super) const FACE_VERTICES: usize = 9409;
const LIPS_CM: f32 = 0.8;
/// Vertices that a shape moves by no more than this do not count as moving.
const MOVING_MM: f32 = 0.5;
const FRAMES: usize = 20;
/// The first seed of the unseen heads. Training draws its own identities from small seeds.
pub(super) const UNSEEN_SEED: u64 = 9_000_000;

/// Measure the field on the vertices of unseen heads, compared with the decoder of landmarks
#[derive(Args)]
pub(super) struct Field {
    #[command(flatten)]
    data: DataArgs,
    /// Number of heads
    #[arg(long, value_name = "N", default_value_t = 3)]
    heads: u64,
    /// Instead, measure a rig's ARKit shapes by the network and by the field, at half and at full
    /// weight
    #[arg(long)]
    rig: bool,
}

/// Distances from the truth, over the face, over the lips and over the vertices that move.
#[derive(Default, Clone, Copy)]
pub(super) struct Distances {
    sums: [f64; 3],
    counts: [f64; 3],
}

impl Field {
    pub(super) fn run(&self, shared: &SharedArgs, _: &Console) -> Result<()> {
        let data = self.data.folder()?;
        let ict = FaceModel::ict(&data)?;
        let engine = shared.engine_of(Some("facetalk"))?;
        let head = Arc::new(Head::open(shared.weights.as_deref())?);
        if self.rig {
            return self.rigs(&ict, &engine, &head);
        }
        let sets = self.poses(&data, &head)?;
        let names = [
            "no motion",
            "decoder of true landmarks",
            "landmarks of the mean head",
            "field",
            "field, fit known",
        ];
        let mut sums = vec![vec![Distances::default(); names.len()]; sets.len()];
        for number in 0..self.heads {
            let coefficients = Head::random(UNSEEN_SEED + number);
            let face = face_of(&engine, &ict, &coefficients)?;
            let begun = Instant::now();
            let field = HeadOnMesh::new(
                Arc::clone(&head),
                &face,
                Reach::default(),
                &Cache::new(&CachePolicy::Off),
                SILENT,
            )?
            .map_err(Error::InvalidInput)?;
            let follow = field.shares()[..FACE_VERTICES].iter().sum::<f32>() / FACE_VERTICES as f32;
            println!(
                "head {number}: fitted to {:.2} mm, {:.3} of the face follows, {:.2} s",
                field.fit().mean_mm,
                follow,
                begun.elapsed().as_secs_f64()
            );
            let mut known = field.fit().clone();
            known.coefficients = coefficients.clone();
            let known =
                HeadOnMesh::of_fit(Arc::clone(&head), &face, known, Reach::default(), SILENT)?;
            let lips = lips(&ict, &face.mesh);
            for (set, (_, weights)) in sets.iter().enumerate() {
                let truth = ict.moved(&head.config().channels, weights);
                let rows: Vec<Vec<f32>> = weights
                    .outer_iter()
                    .map(|row| head.expression_code(&row.to_vec()))
                    .collect::<Result<_>>()?;
                let codes = Array2::from_shape_fn((rows.len(), rows[0].len()), |(t, n)| rows[t][n]);
                let still = Array3::zeros(truth.dim());
                let marks = truth.select(Axis(1), &ict.landmarks.map(|v| v as usize));
                let decoded = spread_landmarks(&engine, &face, marks)?;
                let mean = field.landmarks(codes.view())?;
                let landmarked =
                    spread_landmarks(&engine, &face, face.motion_on_mesh(mean.view()))?;
                let with_field = &landmarked + &field.beyond(codes.view(), &landmarked)?;
                let of_known = &landmarked + &known.beyond(codes.view(), &landmarked)?;
                for (n, prediction) in [&still, &decoded, &landmarked, &with_field, &of_known]
                    .into_iter()
                    .enumerate()
                {
                    sums[set][n].add(prediction, &truth, &lips);
                }
            }
        }
        for ((name, _), sums) in sets.iter().zip(&sums) {
            println!("{name}");
            for (kind, sum) in names.iter().zip(sums) {
                let [face, lips, _] = sum.means_mm();
                println!("  {kind:>26}: {face:.3} mm, lips {lips:.3}");
            }
        }
        Ok(())
    }

    /// Compares both rigs of unseen heads with ICT's own modes, over the vertices of the face that
    /// a mode moves.
    fn rigs(&self, ict: &FaceModel, engine: &Engine, head: &Head) -> Result<()> {
        let channels = &head.config().channels;
        let mut sums = vec![[[0.0f64; 3]; 2]; channels.len()];
        for number in 0..self.heads {
            let face = face_of(engine, ict, &Head::random(UNSEEN_SEED + number))?;
            let network = engine.rig(&face, ShapeSource::Network, SILENT)?;
            let field = engine.rig(&face, ShapeSource::Field { in_betweens: true }, SILENT)?;
            for (channel, sums) in channels.iter().zip(&mut sums) {
                let weights = pose_of(channels, &[channel]);
                let truth = ict.moved(channels, &weights);
                let of = |rig: &Rig, name: &str| {
                    let place = rig.names.iter().position(|known| known == name);
                    place.map(|place| rig.deltas.index_axis(Axis(0), place).to_owned())
                };
                let missing =
                    || Error::InvalidInput(format!("{channel}: expected a shape, got none"));
                let whole = of(&network, channel).ok_or_else(missing)?;
                let predictions = [
                    (0.5, &whole * 0.5, of(&field, &format!("{channel}_half"))),
                    (1.0, whole, of(&field, channel)),
                ];
                for ((weight, network, field), sums) in predictions.into_iter().zip(sums) {
                    let field = field.ok_or_else(missing)?;
                    for v in 0..FACE_VERTICES {
                        let whole = [0, 1, 2].map(|i| truth[[0, v, i]]);
                        if MM_PER_CM * distance(whole, [0.0; 3]) > MOVING_MM {
                            let to = whole.map(|x| weight * x);
                            let off = |predictions: &Array2<f32>| {
                                let predictions = [0, 1, 2].map(|i| predictions[[v, i]]);
                                f64::from(MM_PER_CM * distance(predictions, to))
                            };
                            sums[0] += 1.0;
                            sums[1] += off(&network);
                            sums[2] += off(&field);
                        }
                    }
                }
            }
        }
        println!("mm, network / field at 0.5, network / field at 1");
        let mut all = [[0.0; 3]; 2];
        let line = |[half, whole]: &[[f64; 3]; 2]| {
            let mean = |sums: &[f64; 3], n: usize| sums[n] / sums[0].max(1.0);
            let (a, b) = (mean(half, 1), mean(half, 2));
            format!("{a:.3} {b:.3}  {:.3} {:.3}", mean(whole, 1), mean(whole, 2))
        };
        for (channel, sums) in channels.iter().zip(&sums) {
            println!("  {channel:>20}: {}", line(sums));
            for (all, sum) in all.iter_mut().flatten().zip(sums.iter().flatten()) {
                *all += sum;
            }
        }
        println!("  {:>20}: {}", "all", line(&all));
        Ok(())
    }

    fn poses(&self, data: &Path, head: &Head) -> Result<Vec<(String, Array2<f32>)>> {
        let channels = &head.config().channels;
        let mut sets = Vec::new();
        for shapes in [
            &["cheekPuff"][..],
            &["cheekSquintLeft", "cheekSquintRight"],
            &["noseSneerLeft", "noseSneerRight"],
            &["jawOpen"],
            &["mouthPucker"],
            &["mouthSmileLeft", "mouthSmileRight"],
            &["eyeBlinkLeft", "eyeBlinkRight"],
        ] {
            sets.push((shapes.join(" "), pose_of(channels, shapes)));
        }
        sets.push(("grid_s1, held out".into(), spoken(data, channels)?));
        Ok(sets)
    }
}

/// Weights `[1, M]` of the channels. Those in `full` are at full strength, all others at zero.
fn pose_of(channels: &[String], full: &[impl AsRef<str>]) -> Array2<f32> {
    Array2::from_shape_fn((1, channels.len()), |(_, n)| {
        f32::from(u8::from(
            full.iter().any(|name| name.as_ref() == channels[n]),
        ))
    })
}

/// Weights `[T, M]` of the channels in the middle frames of some held-out clips of grid_s1.
pub(super) fn spoken(data: &Path, channels: &[String]) -> Result<Array2<f32>> {
    let file = TensorFile::read(&data.join(TRACK))?;
    let (weights, shape) = file.floats("weights")?;
    let names = file.words("weight_names")?;
    let clips = file.words("clips")?;
    let spans = spans(&file, clips.len())?;
    let middles = every_tenth(&clips, 0).into_iter().take(FRAMES);
    let middles: Vec<usize> = middles
        .map(|c| (spans[c].start + spans[c].end) / 2)
        .collect();
    let columns: Vec<_> = channels
        .iter()
        .map(|channel| names.iter().position(|name| name == channel))
        .collect();
    let size = (middles.len(), channels.len());
    Ok(Array2::from_shape_fn(size, |(t, n)| {
        columns[n].map_or(0.0, |c| weights[middles[t] * shape[1] + c] / 255.0)
    }))
}

impl Distances {
    /// Adds the distances between a prediction and the truth, both in centimetres.
    pub(super) fn add(&mut self, prediction: &Array3<f32>, truth: &Array3<f32>, lips: &[bool]) {
        for (prediction, truth) in prediction.outer_iter().zip(truth.outer_iter()) {
            for (v, is_lip) in lips.iter().enumerate() {
                let [prediction, to] =
                    [prediction, truth].map(|all| [0, 1, 2].map(|i| all[[v, i]]));
                let moves = MM_PER_CM * distance(to, [0.0; 3]) > MOVING_MM;
                let off = f64::from(MM_PER_CM * distance(prediction, to));
                for (n, counts) in [true, *is_lip, moves].into_iter().enumerate() {
                    if counts {
                        self.sums[n] += off;
                        self.counts[n] += 1.0;
                    }
                }
            }
        }
    }

    pub(super) fn join(&mut self, other: &Distances) {
        for n in 0..3 {
            self.sums[n] += other.sums[n];
            self.counts[n] += other.counts[n];
        }
    }

    /// Mean distances in millimetres over the face, over the lips and over the vertices that move.
    pub(super) fn means_mm(&self) -> [f64; 3] {
        std::array::from_fn(|n| self.sums[n] / self.counts[n].max(1.0))
    }
}

/// An unseen ICT head, ready to be animated.
pub(super) fn face_of(engine: &Engine, ict: &FaceModel, coefficients: &[f32]) -> Result<Face> {
    engine.prepare(&ict.mesh(coefficients)?, &ict.options(), SILENT)
}

/// `[FACE_VERTICES]`, whether a vertex lies near the mouth.
pub(super) fn lips(ict: &FaceModel, mesh: &Mesh) -> Vec<bool> {
    let at = |v: u32| mesh.positions[v as usize];
    let near = |v: u32, l: u32| distance(at(v), at(l)) < LIPS_CM;
    (0..FACE_VERTICES as u32)
        .map(|v| ict.landmarks[48..].iter().any(|l| near(v, *l)))
        .collect()
}
