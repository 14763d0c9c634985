//! Turns takes of one face into weights of ARKit's shapes without computing the frames in between.
//!
//! The weights are the same that [`TakeShapes`] solves on all vertices. A solve needs only the
//! products of the motion with the shapes, and the deformer computes these from landmarks
//! ([`ShapeProducts`]). So a take costs the same on a mesh of any size, except for the vertices
//! around the mouth and the eyes.

use std::{collections::BTreeSet, sync::Arc};

use ndarray::{Array2, Array3, Axis};

use super::take_shapes::{TakeShapes, looks};
use crate::{
    Result,
    face::{Deformer, Face, Rig, ShapeProducts},
    job::ProgressFn,
    motion::{LandmarkClip, Life, WeightClip},
    rig::{ARKIT, MotionSums, ShapeSolver, SolveOptions, closures::gaps},
    spread::{FaceTongue, closed_on},
};

/// The shapes of one face, ready for any number of takes.
pub struct TakeWeights {
    shapes: TakeShapes,
    rig: Arc<Rig>,
    solver: ShapeSolver,
    /// Numbers of the shapes that are still unknown once the weights of the gaze are known.
    without_eyes: Vec<usize>,
    /// `[52]`, how far each shape parts the lips, millimetres on a human head.
    opening_mm: Vec<f32>,
    quick: Option<Quick>,
}

/// Computes a take's sums from its landmark motion, without frames.
struct Quick {
    products: Box<dyn ShapeProducts>,
    /// Pairs of lip vertices, as indices into the shown vertices.
    lips: Vec<[u32; 2]>,
    tongue: Option<ShownTongue>,
}

/// The tongue, with its vertices as indices into the shown vertices.
struct ShownTongue {
    tongue: FaceTongue,
    /// `[3 shown, 52]`, the shapes at the shown vertices.
    shapes: Array2<f32>,
}

impl TakeWeights {
    /// Computes everything that does not depend on a take, in a few passes over the vertices.
    /// `rig`: the rig of `face`, which starts with the shapes of [`ARKIT`].
    pub(crate) fn new(face: &Face, rig: Arc<Rig>, deformer: &dyn Deformer) -> TakeWeights {
        let shapes = TakeShapes::new(Arc::clone(&rig), &face.landmarks.vertices);
        let deltas = rig.deltas.slice(ndarray::s![..ARKIT.len(), .., ..]);
        let is_free = |s: &usize| !ARKIT[*s].starts_with("eyeLook");
        TakeWeights {
            solver: ShapeSolver::new(&rig.names[..ARKIT.len()], deltas, shapes.lips()),
            without_eyes: (0..ARKIT.len()).filter(is_free).collect(),
            opening_mm: opening_mm(face, &gaps(shapes.lips(), deltas)),
            quick: Quick::new(face, &rig, shapes.lips(), deformer),
            shapes,
            rig,
        }
    }

    /// Whether takes of landmarks can be solved without their frames.
    pub fn is_quick(&self) -> bool {
        self.quick.is_some()
    }

    /// The shapes of the face.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// How much further than at rest the weights `[T, 52]` part the lips: `[T]`, millimetres on a
    /// human head.
    pub fn lip_gap_mm(&self, weights: &Array2<f32>) -> Vec<f32> {
        weights.dot(&ndarray::aview1(&self.opening_mm)).to_vec()
    }

    /// Weights `[T, 52]` of a take of landmarks on the mean face. `None` if the solve needs all
    /// frames.
    ///
    /// # Errors
    /// Those of [`crate::rig::solve`].
    pub(crate) fn of_landmarks(
        &self,
        face: &Face,
        clip: &LandmarkClip,
        life: &Life,
        progress: ProgressFn<'_>,
    ) -> Result<Option<Array2<f32>>> {
        let Some(quick) = &self.quick else {
            return Ok(None);
        };
        let landmarks = face.motion_on_mesh(clip.displacements.view());
        let mut sums = quick.sums(&landmarks, life)?;
        let mut weights = looks(clip.displacements.len_of(Axis(0)), Some(life));
        let options = SolveOptions::default();
        if weights.iter().all(|w| *w == 0.0) {
            let solved = self.solver.weights(sums, &options, progress)?;
            return Ok(Some(solved));
        }
        self.solver.take_out(&weights.mapv(f64::from), &mut sums);
        sums.products = sums.products.select(Axis(1), &self.without_eyes);
        let solver = self.solver.select(&self.without_eyes);
        let solved = solver.weights(sums, &options, progress)?;
        for (column, s) in solved.columns().into_iter().zip(&self.without_eyes) {
            weights.column_mut(*s).assign(&column);
        }
        Ok(Some(weights))
    }

    /// Weights `[T, 52]` of a take of frames `[T, V, 3]`, mesh units.
    ///
    /// # Errors
    /// Those of [`crate::rig::solve`].
    pub(crate) fn of_frames(
        &self,
        frames: &Array3<f32>,
        life: &Life,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        self.shapes.arkit(frames.view(), Some(life), progress)
    }

    /// Weights `[T, 52]` of a take that consists of weights, adjusted so that the lips meet on this
    /// face.
    pub(crate) fn of_weights(&self, face: &Face, clip: &WeightClip, life: &Life) -> Array2<f32> {
        let closed = closed_on(face, &self.rig, clip);
        let mut weights = looks(closed.weights.nrows(), Some(life));
        let is_looking = weights.iter().any(|w| *w > 0.0);
        for (s, name) in ARKIT.iter().enumerate() {
            if let Some(column) = closed.column(name)
                && !(is_looking && name.starts_with("eyeLook"))
            {
                weights.column_mut(s).assign(&closed.weights.column(column));
            }
        }
        weights
    }
}

impl Quick {
    fn new(face: &Face, rig: &Rig, lips: &[[u32; 2]], deformer: &dyn Deformer) -> Option<Quick> {
        let tongue = FaceTongue::find(face).ok();
        let of_tongue = tongue.iter().flat_map(FaceTongue::numbers);
        let shown: BTreeSet<usize> = of_tongue
            .chain(lips.iter().flatten().map(|v| *v as usize))
            .collect();
        let shown = Vec::from_iter(shown);
        let numbers: Vec<u32> = shown.iter().map(|v| *v as u32).collect();
        let deltas = rig.deltas.slice(ndarray::s![..ARKIT.len(), .., ..]);
        let among = |v: u32| numbers.binary_search(&v).map_or(0, |at| at as u32);
        let at_shown = deltas.select(Axis(1), &shown);
        let flat = at_shown.to_shape((ARKIT.len(), 3 * shown.len()));
        let shapes = flat.expect("row-major array").t().to_owned();
        Some(Quick {
            products: deformer.products_with(deltas, &numbers)?,
            lips: lips.iter().map(|pair| pair.map(among)).collect(),
            tongue: tongue
                .and_then(|tongue| tongue.among(&shown))
                .map(|tongue| ShownTongue { tongue, shapes }),
        })
    }

    /// The sums that a solve needs for the motion `landmarks` `[T, 68, 3]` of the face, mesh units,
    /// with the tongue of `life`.
    fn sums(&self, landmarks: &Array3<f32>, life: &Life) -> Result<MotionSums> {
        let (mut products, mut moved) = self.products.of(landmarks.view())?;
        if let Some(ShownTongue { tongue, shapes }) = &self.tongue {
            let before = moved.clone();
            tongue.speak(life.tongue.view(), &mut moved);
            let (frames, count, _) = moved.dim();
            let change = &moved - &before;
            let change = change.to_shape((frames, 3 * count));
            let change = change.expect("row-major array").dot(shapes);
            products += &change.mapv(f64::from);
        }
        Ok(MotionSums {
            products,
            gaps: gaps(&self.lips, moved.view()),
        })
    }
}

/// How far each shape parts the lips: the mean over pairs of lip vertices, millimetres on a human
/// head. `gaps`: `[52, 3 N]`, mesh units.
fn opening_mm(face: &Face, gaps: &Array2<f64>) -> Vec<f32> {
    let to_mm = 1e3 * face.metres_per_unit();
    let pairs = (gaps.ncols() / 3).max(1) as f64;
    let of_shape = |row: ndarray::ArrayView1<'_, f64>| {
        let axes = [0, 1, 2].map(|axis| row.iter().skip(axis).step_by(3).sum::<f64>() as f32);
        (to_mm * f64::from(face.to_canonical.rotate(axes)[1]) / pairs) as f32
    };
    gaps.rows().into_iter().map(of_shape).collect()
}
