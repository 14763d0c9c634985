//! What can still change in a finished take without a new run.
//!
//! A slider at 1 shows the take itself. For every other knot, the engine makes a variation from the
//! same speech features and noise. It then expresses what the variation changes on the mesh,
//! through landmarks or weights of shapes, in the shapes of the take. Between its knots a slider is
//! linear.

use std::collections::BTreeSet;

use ndarray::{Array2, Array3, ArrayViewMut1, Axis};
use rayon::prelude::*;

use super::{Engine, Performance};
use crate::{
    Error, Result,
    conditions::{EmotionCurve, MAX_INTENSITY},
    deform::{
        VertexClip,
        compression::VertexBasis,
        projection::{Projection, choose_probes},
    },
    face::{Deformer, Face},
    job::{Progress, ProgressFn, report},
    motion::{EmotionOrigin, LandmarkClip, Life, Motion, WeightClip},
    nn::vectors::columns_of,
    rig::ShapeSource,
    spread::{FaceTongue, closed_on, of_shapes},
    systems::Slider,
};

const STAGE: &str = "sliders";
/// Controls that sliders scale.
const ARTICULATION: &str = "articulation";
const BLINKS: &str = "blinks_per_minute";
/// The largest position of the articulation slider.
const MOST: f32 = 2.0;
/// The largest position of the emotion slider.
const MAX_EMOTION: f32 = 1.5;
/// Further knots of the articulation slider for a tongue that speaks. Articulation also opens the
/// jaw, so the tongue answers with the square of articulation, until it meets teeth.
const BETWEEN_TONGUE: [f32; 3] = [0.5, 1.2, 1.5];
/// The middle knot of the emotion slider. At half an emotion, faces move by more than half.
const MIDDLE_EMOTION: f32 = 0.5;
/// The largest value to which a control is scaled.
const MAX_CONTROL: f32 = 2.0;
/// Frames whose vertices are in memory at one time.
const FRAMES_AT_ONCE: usize = 64;
/// About this many vertices are compared in each frame.
const PROBES: usize = 3000;
/// A knot may move this many shapes that the take leaves at 0 in a frame: those that move the face
/// most. More would cost the host time, because it spends time on every shape that moves in a
/// frame.
const MOVED_BESIDE: usize = 4;
/// This many more if the tongue speaks, because it has shapes of its own.
const MOVED_BY_TONGUE: usize = 2;

/// What a slider adds to the weights of a take.
#[derive(Debug, Clone, PartialEq)]
pub struct SliderChange {
    /// Which slider.
    pub slider: Slider,
    /// Positions in ascending order. 1 is never among them, because nothing is added there.
    pub knots: Vec<f32>,
    /// What each knot adds to the weights, `[T, K]`.
    pub changes: Vec<Array2<f32>>,
}

impl SliderChange {
    /// What the slider adds at `position`, `[T, K]`: linear between the knots and 1, constant
    /// beyond the outermost.
    pub fn at(&self, position: f32) -> Array2<f32> {
        let mut out = Array2::zeros(self.changes[0].dim());
        let above = self.knots.partition_point(|knot| *knot < 1.0);
        let mut ways: Vec<(f32, Option<&Array2<f32>>)> = self
            .knots
            .iter()
            .copied()
            .zip(self.changes.iter().map(Some))
            .collect();
        ways.insert(above, (1.0, None));
        let place = position.clamp(ways[0].0, ways[ways.len() - 1].0);
        let last = ways
            .partition_point(|way| way.0 <= place)
            .clamp(1, ways.len() - 1);
        let (from, to) = (ways[last - 1], ways[last]);
        let share = (place - from.0) / (to.0 - from.0);
        for (weight, (_, change)) in [(1.0 - share, from), (share, to)] {
            if let Some(change) = change {
                out.scaled_add(weight, change);
            }
        }
        out
    }
}

impl Performance {
    /// The positions of a slider at which variations are made, in ascending order, without 1. Empty
    /// if the slider has nothing to scale.
    pub fn knots(&self, engine: &Engine, slider: Slider) -> Vec<f32> {
        let controls = &self.request.controls;
        if controls.change_over_time() || !engine.registration.sliders.contains(&slider) {
            return Vec::new();
        }
        let emotion = &self.request.emotion;
        let speech_only = *emotion == EmotionCurve::Off;
        let value = |name| engine.control(&self.request, name);
        let up_to = |value: f32, most: f32, limit: f32| (limit / value).min(most);
        let knots = match slider {
            Slider::Articulation if value(ARTICULATION) > 0.0 => {
                vec![0.0, up_to(value(ARTICULATION), MOST, MAX_CONTROL)]
            }
            Slider::Emotion if emotion.strongest() > 0.0 => {
                let most = up_to(emotion.strongest(), MAX_EMOTION, MAX_INTENSITY);
                vec![0.0, MIDDLE_EMOTION, most]
            }
            Slider::Blinks if !speech_only && value(BLINKS) > 0.0 => vec![0.0],
            Slider::EmotionAndBlinks => {
                let parts = [Slider::Emotion, Slider::Blinks].map(|part| self.knots(engine, part));
                let both = parts.iter().all(|knots| !knots.is_empty());
                if both { vec![0.0] } else { vec![] }
            }
            _ => Vec::new(),
        };
        knots
            .into_iter()
            .filter(|knot| (knot - 1.0).abs() > 0.01)
            .collect()
    }

    /// Motion, head, eyes and tongue of the performance with one slider at `position`. A
    /// slider of blinks removes them at 0 and leaves them unchanged at any other position.
    ///
    /// # Errors
    /// Those of [`Engine::perform`].
    pub fn varied(
        &self,
        engine: &Engine,
        slider: Slider,
        position: f32,
        progress: ProgressFn<'_>,
    ) -> Result<(Motion, Life)> {
        let mut request = self.request.clone();
        let (emotion, blinks) = match slider {
            Slider::Articulation => (false, false),
            Slider::Emotion => (true, false),
            Slider::Blinks => (false, true),
            Slider::EmotionAndBlinks => (true, true),
        };
        if slider == Slider::Articulation {
            let scaled = engine.control(&self.request, ARTICULATION) * position;
            request.controls.set(ARTICULATION, scaled.min(MAX_CONTROL));
        }
        if blinks && position == 0.0 {
            request.controls.set(BLINKS, 0.0);
        }
        let (heard, blink_emotion) = (&self.heard, &self.request.emotion);
        if emotion {
            request.emotion = request.emotion.scaled(position);
        }
        let learned = engine.description().emotion == EmotionOrigin::Learned;
        engine.threads(|| {
            if emotion && learned {
                let sampled = engine.system.sample(heard, &request, progress)?.motion;
                engine.controlled(&sampled, heard, &request, blink_emotion)
            } else {
                engine.controlled(&self.sampled.motion, heard, &request, blink_emotion)
            }
        })
    }

    /// What each slider changes in the weights of a take's shapes. Sliders that move nothing are
    /// left out.
    ///
    /// `clip` is this performance on `face`; `basis` is the same clip expressed in a few shapes.
    ///
    /// # Errors
    /// `InvalidInput` if clip and basis do not belong to the performance and the face; `Cancelled`.
    pub fn slider_changes(
        &self,
        engine: &Engine,
        face: &Face,
        clip: &VertexClip,
        basis: &VertexBasis,
        progress: ProgressFn<'_>,
    ) -> Result<Vec<SliderChange>> {
        check_take(self, face, clip, basis)?;
        let take = (&self.motion, &self.life);
        let mut ways = Slider::ALL.map(|slider| (slider, self.knots(engine, slider)));
        if ways.iter().all(|(_, knots)| knots.is_empty()) {
            return Ok(Vec::new());
        }
        let vertices = choose_probes(basis, PROBES);
        let way = engine.way(face, vertices, progress)?;
        let speaks = way.tongue.is_some() && self.life.tongue.iter().any(|share| *share != 0.0);
        if speaks {
            ways.iter_mut()
                .filter(|(slider, _)| *slider == Slider::Articulation)
                .for_each(|(_, knots)| add_between(knots));
        }
        let count = ways.iter().map(|(_, knots)| knots.len()).sum::<usize>();
        let mut measure = Measure::new(way, clip, basis)?;
        measure.beside += if speaks { MOVED_BY_TONGUE } else { 0 };
        let mut done = 0;
        let mut out = Vec::new();
        for (slider, knots) in ways {
            let mut changes = Vec::new();
            for knot in &knots {
                let fraction = done as f32 / count as f32;
                let within = |_: Progress| {
                    progress(Progress {
                        stage: STAGE,
                        fraction,
                    })
                };
                let (motion, life) = self.varied(engine, slider, *knot, &within)?;
                let change = engine.threads(|| measure.change(take, (&motion, &life), &within))?;
                changes.push(match slider {
                    Slider::EmotionAndBlinks => beyond_each(change, &out),
                    _ => change,
                });
                done += 1;
            }
            if changes
                .iter()
                .any(|change| change.iter().any(|x| *x != 0.0))
            {
                out.push(SliderChange {
                    slider,
                    knots,
                    changes,
                });
            }
        }
        report(progress, STAGE, 1.0)?;
        Ok(out)
    }
}

/// Adds the knots of [`BETWEEN_TONGUE`] that lie between the first and the last of `knots`, in
/// ascending order.
fn add_between(knots: &mut Vec<f32>) {
    if let (Some(&first), Some(&last)) = (knots.first(), knots.last()) {
        let between = BETWEEN_TONGUE
            .iter()
            .filter(|knot| first < **knot && **knot < last);
        knots.extend(between);
        knots.sort_by(f32::total_cmp);
    }
}

/// How motion reaches some vertices of a face.
struct Way<'a> {
    face: &'a Face,
    engine: &'a Engine,
    /// Moves the whole face.
    deformer: &'a dyn Deformer,
    /// Moves only `vertices`, if the deformer of the face offers that.
    few: Option<Box<dyn Deformer>>,
    vertices: Vec<usize>,
    /// The tongue, all of whose vertices are in `vertices`.
    tongue: Option<FaceTongue>,
    /// The vertices whose displacements show how the face moves: their positions in `vertices`, and
    /// their numbers in the mesh.
    probe_indices: Vec<usize>,
    probes: Vec<usize>,
}

/// The displacements of some vertices of `[F, V, 3]`.
fn of_vertices(moved: &Array3<f32>, vertices: &[usize]) -> Array3<f32> {
    let (frames, all, _) = moved.dim();
    let flat = moved.view().into_shape_with_order((frames, 3 * all));
    let chosen = columns_of(flat.expect("row-major"), vertices);
    let shape = (frames, vertices.len(), 3);
    let chosen = chosen.into_shape_with_order(shape);
    chosen.expect("the same number of values")
}

/// A motion with its head, eyes and tongue.
type Moving<'a> = (&'a Motion, &'a Life);

impl Way<'_> {
    /// Displacements of the probes in some `frames` of a motion, `[F, S, 3]`.
    fn frames(
        &self,
        (motion, life): Moving<'_>,
        frames: &[usize],
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let mut moved = match motion {
            Motion::Landmarks(clip) => self.of_landmarks(clip, frames, progress),
            Motion::Codes(clip) => self.of_landmarks(&clip.landmarks, frames, progress),
            Motion::Weights(clip) => self.of_weights(&clip.rows(frames), progress),
        }?;
        if let Some(tongue) = &self.tongue {
            tongue.speak(life.tongue.select(Axis(0), frames).view(), &mut moved);
        }
        Ok(of_vertices(&moved, &self.probe_indices))
    }

    fn of_landmarks(
        &self,
        clip: &LandmarkClip,
        frames: &[usize],
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let landmarks = clip.displacements.select(Axis(0), frames);
        let landmarks = self.face.motion_on_mesh(landmarks.view());
        match &self.few {
            Some(few) => few.deform(landmarks.view(), progress),
            None => {
                let all = self.deformer.deform(landmarks.view(), progress)?;
                Ok(of_vertices(&all, &self.vertices))
            }
        }
    }

    fn of_weights(&self, clip: &WeightClip, progress: ProgressFn<'_>) -> Result<Array3<f32>> {
        report(progress, "deform", 0.0)?;
        let rig = self.engine.rig(self.face, ShapeSource::Network, progress)?;
        let landmarks = self.engine.landmarks_of_weights(self.face, clip)?;
        let clip = closed_on(self.face, &rig, clip);
        let mut moved = of_shapes(&rig, &self.vertices, &clip);
        if let Some(few) = &self.few {
            few.shut_lids(landmarks.view(), &mut moved);
        }
        Ok(moved)
    }
}

/// Everything needed to express motion of a face in the shapes of one take.
struct Measure<'a> {
    way: Way<'a>,
    clip: &'a VertexClip,
    basis: &'a VertexBasis,
    projection: Projection,
    /// The largest displacement of any vertex by each shape at weight 1, `[K]`.
    sizes: Vec<f32>,
    /// How many of the shapes that a frame of the take leaves at 0 may move.
    beside: usize,
}

impl Engine {
    /// How motion reaches the `probes` of a face and its tongue, all of whose vertices must be
    /// included.
    fn way<'a>(
        &'a self,
        face: &'a Face,
        probes: Vec<u32>,
        progress: ProgressFn<'_>,
    ) -> Result<Way<'a>> {
        let deformer = self.threads(|| self.deformer(face, progress))?.as_ref();
        let tongue = FaceTongue::find(face).ok();
        let beside: BTreeSet<usize> = tongue.iter().flat_map(FaceTongue::numbers).collect();
        let known: BTreeSet<u32> = probes.iter().copied().collect();
        // The motion of a tongue depends on all of its vertices.
        let subset = beside.iter().map(|&v| v as u32).chain(probes);
        let subset: Vec<u32> = BTreeSet::from_iter(subset).into_iter().collect();
        let (few, vertices) = match deformer.of_vertices(&subset) {
            Some(few) => (Some(few.deformer), few.vertices),
            None => (None, subset),
        };
        let vertices: Vec<usize> = vertices.iter().map(|&v| v as usize).collect();
        let is_probe = |v: &usize| known.contains(&(*v as u32)) || !beside.contains(v);
        let probe_indices: Vec<usize> = (0..vertices.len())
            .filter(|&at| is_probe(&vertices[at]))
            .collect();
        Ok(Way {
            face,
            engine: self,
            deformer,
            few,
            tongue: tongue.and_then(|tongue| tongue.among(&vertices)),
            probes: probe_indices.iter().map(|&at| vertices[at]).collect(),
            probe_indices,
            vertices,
        })
    }
}

impl Measure<'_> {
    fn new<'a>(way: Way<'a>, clip: &'a VertexClip, basis: &'a VertexBasis) -> Result<Measure<'a>> {
        let vertices: Vec<u32> = way.probes.iter().map(|&v| v as u32).collect();
        let projection = Projection::new(basis, &vertices)?;
        Ok(Measure {
            way,
            clip,
            basis,
            sizes: projection.sizes(),
            projection,
            beside: MOVED_BESIDE,
        })
    }

    /// How the weights `[T, K]` of the take have to change to show `varied`. `take`: the take's own
    /// motion.
    fn change(
        &self,
        take: Moving<'_>,
        varied: Moving<'_>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let count = take.0.frames();
        let (was, is) = (take.0.values(), varied.0.values());
        let has_tongue = self.way.tongue.is_some();
        let differs = |t: &usize| {
            was.index_axis(Axis(0), *t) != is.index_axis(Axis(0), *t)
                || has_tongue && take.1.tongue.row(*t) != varied.1.tongue.row(*t)
        };
        let frames: Vec<usize> = (0..count).filter(differs).collect();
        let changes = frames.par_chunks(FRAMES_AT_ONCE).map(|frames| {
            let mut moved = self.moved(varied, frames, progress)?;
            if let Motion::Codes(_) = take.0 {
                // The clip contains what the codes add to the landmarks. Both motions have the same
                // codes, so the difference from the take's own motion is free of it.
                moved -= &self.moved(take, frames, progress)?;
            }
            let mut weights = self.projection.weights(&moved);
            for (&t, row) in frames.iter().zip(weights.outer_iter_mut()) {
                self.keep_few(t, row);
            }
            Ok(weights)
        });
        let changes: Vec<Array2<f32>> = changes.collect::<Result<_>>()?;
        let mut out = Array2::zeros((count, self.projection.shapes()));
        let rows = changes.iter().flat_map(|part| part.outer_iter());
        for (&t, row) in frames.iter().zip(rows) {
            out.row_mut(t).assign(&row);
        }
        Ok(out)
    }

    /// Limits the change `[K]` of a frame. Shapes that the take moves keep theirs; of the others,
    /// only those that move the face most do.
    fn keep_few(&self, frame: usize, mut change: ArrayViewMut1<'_, f32>) {
        let take = self.basis.weights.row(frame);
        let reach = |k: usize| change[k].abs() * self.sizes[k];
        let mut still: Vec<usize> = (0..take.len()).filter(|&k| take[k] == 0.0).collect();
        still.sort_by(|&a, &b| reach(b).total_cmp(&reach(a)));
        for &k in still.iter().skip(self.beside) {
            change[k] = 0.0;
        }
    }

    /// The displacements `[F, S, 3]` of the probes in some `frames` `[F]` of a motion, minus those
    /// in the take.
    fn moved(
        &self,
        motion: Moving<'_>,
        frames: &[usize],
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let mut moved = self.way.frames(motion, frames, progress)?;
        for (&t, mut frame) in frames.iter().zip(moved.outer_iter_mut()) {
            let clip = self.clip.displacements.index_axis(Axis(0), t);
            let (clip, frame) = (clip.as_slice(), frame.as_slice_mut());
            let (clip, _) = clip.expect("row-major").as_chunks::<3>();
            let (frame, _) = frame.expect("row-major").as_chunks_mut::<3>();
            for (row, &v) in frame.iter_mut().zip(&self.way.probes) {
                (0..3).for_each(|x| row[x] -= clip[v][x]);
            }
        }
        Ok(moved)
    }
}

/// The part of the change `[T, K]` at emotion 0 and blinks 0 that the two sliders do not explain,
/// each on its own; 0 in frames without a blink.
fn beyond_each(mut change: Array2<f32>, changes: &[SliderChange]) -> Array2<f32> {
    let at_rest = |slider: Slider| {
        let one = changes.iter().find(|change| change.slider == slider);
        one.map_or_else(|| Array2::zeros(change.dim()), |change| change.at(0.0))
    };
    let (emotion, blinks) = (at_rest(Slider::Emotion), at_rest(Slider::Blinks));
    for (t, mut row) in change.outer_iter_mut().enumerate() {
        if blinks.row(t).iter().any(|x| *x != 0.0) {
            row -= &(&emotion.row(t) + &blinks.row(t))
        } else {
            row.fill(0.0)
        }
    }
    change
}

/// Checks that clip and basis have the frames of the performance and the vertices of the face.
fn check_take(
    performance: &Performance,
    face: &Face,
    clip: &VertexClip,
    basis: &VertexBasis,
) -> Result<()> {
    let expected = (performance.motion.frames(), face.mesh.positions.len());
    let (frames, vertices, _) = clip.displacements.dim();
    let of_basis = (basis.weights.nrows(), basis.shapes.dim().1);
    if [(frames, vertices), of_basis] == [expected; 2] {
        return Ok(());
    }
    Err(Error::InvalidInput(format!(
        "sliders: expected clip and basis of the motion's {} frames and the face's {} vertices, got a clip of \
         {frames} and {vertices} and a basis of {} and {}",
        expected.0, expected.1, of_basis.0, of_basis.1
    )))
}
