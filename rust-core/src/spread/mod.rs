//! Moves a mesh by each kind of motion.
//!
//! Landmarks move it through a [`Deformer`]. Weights move it through the shapes of its own [`Rig`].
//! Codes move it through their landmarks and a [`CodeField`], which comes from their
//! [`crate::deform::CodeSpace`]. A [`Spread`] computes any range of frames. [`Spread::into_sink`]
//! hands them over block by block, so that a long take on a large mesh is never in memory as a
//! whole.

mod on_face;
mod pose;
mod sink;
mod template_on_face;
mod tongue;

use std::{borrow::Cow, ops::Range, sync::Arc};

use ndarray::{Array2, Array3, ArrayView2, Axis, Slice};
use rayon::prelude::*;

use crate::{
    Error, Result,
    face::{CodeField, Deformer, Face, Field, Rig},
    job::{Progress, ProgressFn, report},
    mesh::{Mouth, ibug::LANDMARKS},
    motion::{CodeClip, Life, LipGaps, Motion, WeightClip, bounds::DISPLACEMENT},
    speech::TONGUE_PLACES,
};
pub use on_face::on_face;
pub use pose::pose_on;
pub use sink::{
    Animation, ClipStart, Collector, FrameBlock, FrameSink, SpreadReport, frames_at_once,
};
pub use template_on_face::TemplateOnFace;
pub(crate) use tongue::FaceTongue;
pub use tongue::tongue_note;

/// A movement to put on a face.
pub enum Movement<'a> {
    /// Motion of the mean face.
    Motion(&'a Motion),
    /// Motion of landmarks in the units and axes of the mesh.
    Own {
        /// `[T, 68, 3]`.
        landmarks: Array3<f32>,
        /// Frames per second.
        fps: f64,
    },
    /// Two motions of the same length, each with the shares `[V]` by which the vertices follow it.
    /// For example speech and emotion, mixed by a painted mask.
    Mixed([(&'a Motion, Vec<f32>); 2]),
    /// Any of these together with the motion of the tongue, `[T, 4]` as in [`Life::tongue`].
    WithTongue(Box<Movement<'a>>, &'a Array2<f32>),
}

impl<'a> Movement<'a> {
    /// Adds the motion of the tongue.
    #[must_use]
    pub fn with_tongue(self, life: &'a Life) -> Movement<'a> {
        Movement::WithTongue(Box::new(self), &life.tongue)
    }
}

impl<'a> From<&'a Motion> for Movement<'a> {
    fn from(motion: &'a Motion) -> Movement<'a> {
        Movement::Motion(motion)
    }
}

/// A motion that is prepared for one mesh.
pub struct Spread<'a> {
    face: &'a Face,
    fps: f64,
    frames: usize,
    way: Way<'a>,
    /// The tongue of the face, and its motion `[T, 4]`.
    tongue: Option<(FaceTongue, Array2<f32>)>,
    notes: Vec<String>,
}

/// What moves the vertices.
enum Way<'a> {
    Landmarks(SpreadLandmarks<'a>),
    /// Shapes of this mesh and their weights over time.
    Shapes(WeightedShapes<'a>),
    /// Two motions of the same length, each with the shares `[V]` by which the vertices follow it.
    Mixed(Box<[(Spread<'a>, Vec<f32>); 2]>),
}

/// Landmark motion that is prepared for one mesh.
struct SpreadLandmarks<'a> {
    deformer: &'a dyn Deformer,
    /// `[T, 68, 3]`, mesh units and axes.
    landmarks: Array3<f32>,
    /// The field that moves vertices in addition to the landmarks, and its codes `[T, X]`.
    field: Option<(Arc<dyn CodeField>, ArrayView2<'a, f32>)>,
}

impl SpreadLandmarks<'_> {
    fn frames(
        &self,
        face: &Face,
        range: Range<usize>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let rows = Slice::from(range);
        let landmarks = self.landmarks.slice_axis(Axis(0), rows);
        match &self.field {
            Some((field, codes)) => {
                let codes = codes.slice_axis(Axis(0), rows);
                face.under_codes((field.as_ref(), self.deformer), landmarks, codes, progress)
            }
            None => self.deformer.deform(landmarks, progress),
        }
    }
}

/// Weights that are prepared for one mesh.
///
/// Shapes add up linearly, so lids closed by shapes alone would not meet under every
/// expression and would not slide over the eyeball. Therefore the deformer shuts the lids, as it
/// does under landmark motion.
pub struct WeightedShapes<'a> {
    /// Shapes of the mesh. Weights of shapes that it lacks move nothing.
    pub rig: Arc<Rig>,
    /// Their weights.
    pub clip: Cow<'a, WeightClip>,
    /// Shuts the lids of the mesh.
    pub deformer: &'a dyn Deformer,
    /// The landmark motion that the weights describe, `[T, 68, 3]`, mesh units and axes.
    pub landmarks: Array3<f32>,
}

impl WeightedShapes<'_> {
    fn frames(&self, range: Range<usize>) -> Array3<f32> {
        let landmarks = self
            .landmarks
            .slice_axis(Axis(0), Slice::from(range.clone()));
        let mut moved = mixed(&self.rig, &self.clip, range);
        self.deformer.shut_lids(landmarks, &mut moved);
        moved
    }
}

impl<'a> Spread<'a> {
    /// Motion of landmarks through a deformer.
    ///
    /// `landmarks`: `[T, 68, 3]`, mesh units and axes.
    pub fn of_landmarks(
        face: &'a Face,
        deformer: &'a dyn Deformer,
        landmarks: Array3<f32>,
        fps: f64,
    ) -> Spread<'a> {
        Spread {
            face,
            fps,
            frames: landmarks.len_of(Axis(0)),
            way: Way::Landmarks(SpreadLandmarks {
                deformer,
                landmarks,
                field: None,
            }),
            tongue: None,
            notes: Vec::new(),
        }
    }

    /// Motion of codes. Their landmarks move the mesh; if the face has a field of codes, that field
    /// also moves it.
    ///
    /// # Errors
    /// `ShapeMismatch` for another number of frames.
    pub fn of_codes(
        face: &'a Face,
        deformer: &'a dyn Deformer,
        clip: &'a CodeClip,
        field: Option<Field>,
    ) -> Result<Spread<'a>> {
        let CodeClip {
            codes, landmarks, ..
        } = clip;
        let motion = face.motion_on_mesh(landmarks.displacements.view());
        let mut spread = Spread::of_landmarks(face, deformer, motion, landmarks.fps);
        if codes.nrows() != spread.frames {
            return Err(Error::ShapeMismatch {
                what: "codes of a motion",
                expected: format!("[{}, X]", spread.frames),
                got: format!("{:?}", codes.dim()),
            });
        }
        match (&mut spread.way, field) {
            (Way::Landmarks(way), Some(Ok(field))) => way.field = Some((field, codes.view())),
            (_, Some(Err(_))) => spread.notes.extend(face.field_note()),
            _ => {}
        }
        Ok(spread)
    }

    /// Weights through shapes of the mesh.
    pub fn of_weights(face: &'a Face, shapes: WeightedShapes<'a>) -> Spread<'a> {
        Spread {
            face,
            fps: shapes.clip.fps,
            frames: shapes.clip.weights.nrows(),
            way: Way::Shapes(shapes),
            tongue: None,
            notes: Vec::new(),
        }
    }

    /// Adds two motions of one face, each times the share `[V]` by which each vertex follows it.
    ///
    /// # Errors
    /// `ShapeMismatch` if the numbers of frames differ, or there is not one share for each vertex.
    pub fn mixed(mut parts: [(Spread<'a>, Vec<f32>); 2]) -> Result<Spread<'a>> {
        let notes = std::mem::take(&mut parts[0].0.notes);
        let [(first, _), (second, _)] = &parts;
        let (face, fps, frames) = (first.face, first.fps, first.frames);
        let vertices = face.mesh.positions.len();
        let wrong = |what, expected: usize, got: usize| Error::ShapeMismatch {
            what,
            expected: format!("[{expected}]"),
            got: format!("[{got}]"),
        };
        if second.frames != frames {
            return Err(wrong("frames of two motions", frames, second.frames));
        }
        let mut shares = parts.iter().map(|(_, shares)| shares.len());
        if let Some(got) = shares.find(|got| *got != vertices) {
            return Err(wrong("shares of the vertices", vertices, got));
        }
        Ok(Spread {
            face,
            fps,
            frames,
            way: Way::Mixed(Box::new(parts)),
            tongue: None,
            notes,
        })
    }

    /// Adds the motion of the tongue, `[T, 4]` as in [`Life::tongue`]. If the face has no tongue
    /// that can move, a note of the report says so.
    ///
    /// # Errors
    /// `ShapeMismatch` for another number of frames.
    pub fn with_tongue(mut self, tongue: ArrayView2<'_, f32>) -> Result<Spread<'a>> {
        if tongue.dim() != (self.frames, TONGUE_PLACES) {
            return Err(Error::ShapeMismatch {
                what: "tongue beside a motion",
                expected: format!("[{}, {TONGUE_PLACES}]", self.frames),
                got: format!("{:?}", tongue.dim()),
            });
        }
        if tongue.iter().all(|share| *share == 0.0) {
            return Ok(self);
        }
        match FaceTongue::find(self.face) {
            Ok(face_tongue) => self.speak(&face_tongue, tongue),
            Err(complaint) => self.notes.push(complaint.into()),
        }
        Ok(self)
    }

    /// Lets the tongue speak. In a mixture, each part moves the tongue along with its own jaw, so
    /// that the parts add up.
    fn speak(&mut self, tongue: &FaceTongue, track: ArrayView2<'_, f32>) {
        match &mut self.way {
            Way::Mixed(parts) => parts
                .iter_mut()
                .for_each(|(part, _)| part.speak(tongue, track)),
            Way::Landmarks(_) | Way::Shapes(_) => {
                self.tongue = Some((tongue.clone(), track.to_owned()))
            }
        }
    }

    /// Displacements in a range of frames, `[t, V, 3]`, mesh units.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn frames(&self, range: Range<usize>, progress: ProgressFn<'_>) -> Result<Array3<f32>> {
        let mut moved = self.without_tongue(range.clone(), progress)?;
        if let Some((tongue, track)) = &self.tongue {
            tongue.speak(track.slice_axis(Axis(0), range.into()), &mut moved);
        }
        Ok(moved)
    }

    fn without_tongue(&self, range: Range<usize>, progress: ProgressFn<'_>) -> Result<Array3<f32>> {
        match &self.way {
            Way::Landmarks(way) => way.frames(self.face, range, progress),
            Way::Shapes(shapes) => {
                report(progress, "deform", 0.0)?;
                let moved = shapes.frames(range);
                report(progress, "deform", 1.0)?;
                Ok(moved)
            }
            Way::Mixed(parts) => {
                let [one, other] = parts.as_ref();
                let mut moved = one.0.frames(range.clone(), progress)?;
                scale_rows(&mut moved, &one.1);
                let mut more = other.0.frames(range, progress)?;
                scale_rows(&mut more, &other.1);
                moved += &more;
                Ok(moved)
            }
        }
    }

    /// The landmark motion `[T, 68, 3]` that moves the mesh; `None` if something else moves it.
    fn landmarks(&self) -> Option<&Array3<f32>> {
        match &self.way {
            Way::Landmarks(way) => Some(&way.landmarks),
            Way::Shapes(_) | Way::Mixed(_) => None,
        }
    }

    /// Makes all frames and hands them to `sink`. Makes the next block while the sink takes one.
    ///
    /// # Errors
    /// Those of [`Spread::frames`] and of the sink.
    pub fn into_sink(
        self,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        sink.begin(&self.start())?;
        let report = self.part_into_sink(sink, progress)?;
        sink.finish(progress)?;
        Ok(report)
    }

    /// Makes all frames and hands them to a sink that has already begun and also gets other frames.
    ///
    /// # Errors
    /// Those of [`Spread::frames`] and of the sink.
    pub fn part_into_sink(
        self,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        let size = sink.frames_at_once(&self.start()).max(1);
        let mut stretches = (0..self.frames)
            .step_by(size)
            .map(|first| first..(first + size).min(self.frames));
        let make = |stretch: Range<usize>| Block::make(&self, stretch, progress);
        let mut landmarks = Array3::zeros((self.frames, LANDMARKS, 3));
        let mut largest = 0.0f32;
        let mut pending = stretches.next().map(make);
        while let Some(block) = pending {
            let block = block?;
            largest = largest.max(block.largest);
            let mut target = landmarks.slice_axis_mut(Axis(0), Slice::from(block.stretch));
            target.assign(&block.frames.landmarks);
            let following = stretches.next();
            let (written, next) = rayon::join(|| sink.take(block.frames), || following.map(make));
            written?;
            pending = next;
        }
        Ok(SpreadReport {
            largest,
            landmarks,
            notes: self.notes,
        })
    }

    fn start(&self) -> ClipStart<'a> {
        ClipStart {
            mesh: &self.face.mesh,
            landmarks: &self.face.landmarks.positions,
            frames: self.frames,
            fps: self.fps,
        }
    }
}

/// Multiplies displacements `[t, V, 3]` by the share of each vertex.
fn scale_rows(moved: &mut Array3<f32>, shares: &[f32]) {
    let frames = moved.as_slice_mut().expect("standard layout");
    frames
        .par_chunks_mut((3 * shares.len()).max(1))
        .for_each(|frame| {
            for (row, share) in frame.as_chunks_mut::<3>().0.iter_mut().zip(shares) {
                *row = row.map(|x| x * share);
            }
        });
}

/// `Σ_s weight[t, s] · shape[s]` for a range of frames, `[t, V, 3]`.
fn mixed(rig: &Rig, clip: &WeightClip, range: Range<usize>) -> Array3<f32> {
    let pairs = pairs(rig, clip);
    let mut out = Array3::zeros((range.len(), rig.deltas.len_of(Axis(1)), 3));
    let frames = out.axis_iter_mut(Axis(0)).into_par_iter();
    frames.zip(range).for_each(|(mut frame, t)| {
        for &(weight, shape) in &pairs {
            let weight = clip.weights[[t, weight]];
            if weight != 0.0 {
                frame.scaled_add(weight, &rig.deltas.index_axis(Axis(0), shape));
            }
        }
    });
    out
}

/// Displacements of some `vertices` alone under the weights of a clip, `[T, V, 3]`, mesh units.
pub(crate) fn of_shapes(rig: &Rig, vertices: &[usize], clip: &WeightClip) -> Array3<f32> {
    let part = Rig {
        names: rig.names.clone(),
        deltas: rig.deltas.select(Axis(1), vertices),
        reports: Vec::new(),
    };
    mixed(&part, clip, 0..clip.weights.nrows())
}

/// Pairs each column of a clip's weights with the number of the shape of the mesh that it moves.
fn pairs(rig: &Rig, clip: &WeightClip) -> Vec<(usize, usize)> {
    let shape_of = |name: &String| rig.names.iter().position(|known| known == name);
    let names = clip.names.iter().enumerate();
    names
        .filter_map(|(w, name)| Some((w, shape_of(name)?)))
        .collect()
}

/// Returns the clip with weights by which the lips meet on this face wherever the clip says so. Lips
/// that are one surface stay as they are.
pub(crate) fn closed_on<'a>(face: &Face, rig: &Rig, clip: &'a WeightClip) -> Cow<'a, WeightClip> {
    if clip.together.is_empty() || face.mouth() == Mouth::Welded {
        return Cow::Borrowed(clip);
    }
    let landmark_deltas = face
        .to_canonical
        .displacements_to_canonical(at_landmarks(face, &rig.deltas).view());
    let mut shapes = Array3::zeros((clip.names.len(), LANDMARKS, 3));
    for (name, mut shape) in clip.names.iter().zip(shapes.outer_iter_mut()) {
        if let Some(known) = rig.names.iter().position(|known| known == name) {
            shape.assign(&landmark_deltas.index_axis(Axis(0), known));
        }
    }
    let mut closed = clip.clone();
    LipGaps::new(shapes.view(), &clip.names).bring_together(&mut closed);
    Cow::Owned(closed)
}

/// Some frames of a clip.
struct Block {
    stretch: Range<usize>,
    frames: FrameBlock,
    largest: f32,
}

impl Block {
    fn make(spread: &Spread<'_>, stretch: Range<usize>, progress: ProgressFn<'_>) -> Result<Block> {
        let (first, count) = (stretch.start as f32, stretch.len() as f32);
        let share = |p: Progress| Progress {
            fraction: (first + p.fraction * count) / spread.frames as f32,
            ..p
        };
        let moved = spread.frames(stretch.clone(), &|p| progress(share(p)))?;
        let frames = moved.axis_iter(Axis(0)).into_par_iter();
        let most = frames.zip(stretch.clone()).map(|(frame, t)| {
            let most = largest(frame.view());
            most.is_finite().then_some(most).ok_or(t)
        });
        let most = most.try_reduce(|| 0.0, |a, b| Ok(a.max(b))).map_err(lost)?;
        let landmarks = match spread.landmarks() {
            Some(landmarks) => landmarks
                .slice_axis(Axis(0), Slice::from(stretch.clone()))
                .to_owned(),
            None => at_landmarks(spread.face, &moved),
        };
        // The report warns of displacements that a face cannot make. Far larger ones are an error.
        DISPLACEMENT.check(&[most * spread.face.metres_per_unit() as f32])?;
        Ok(Block {
            stretch,
            frames: FrameBlock {
                displacements: moved,
                landmarks,
            },
            largest: most,
        })
    }
}

/// The error for a frame that is not finite.
fn lost(frame: usize) -> Error {
    Error::Numerics(format!(
        "displacements: frame {frame} is not finite; expected a mesh, a motion and models whose numbers are not \
         enormous"
    ))
}

/// Length of the longest displacement of `[V, 3]`. NaN if any of them is NaN.
fn largest(frame: ArrayView2<'_, f32>) -> f32 {
    // Views of single rows take ten times as long as the sums themselves.
    let frame = frame.as_standard_layout();
    let (rows, _) = frame.as_slice().expect("standard layout").as_chunks::<3>();
    let squared = rows.iter().map(|d| d.iter().map(|x| x * x).sum::<f32>());
    let (most, sum) = squared.fold((0.0, 0.0), |(most, sum), d| (f32::max(most, d), sum + d));
    if sum.is_nan() { f32::NAN } else { most.sqrt() }
}

/// Picks from displacements `moved` `[t, V, 3]` those of the vertices nearest to the landmarks,
/// `[t, 68, 3]`.
fn at_landmarks(face: &Face, moved: &Array3<f32>) -> Array3<f32> {
    let vertices = face.landmarks.vertices.map(|v| v as usize);
    moved.select(Axis(1), &vertices)
}
