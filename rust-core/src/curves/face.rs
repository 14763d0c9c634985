//! Fits curves so that their sum on the face stays within a tolerance.

use ndarray::{Array2, ArrayView1, ArrayView2, ArrayView3, Axis};
use rayon::prelude::*;

use super::{
    fit::{check, evaluate, fit_checked},
    slopes::Curve,
};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    nn::vectors::{columns_of, longest},
};

/// In frames in which lips touch, the tolerance shrinks to this share.
const TOUCHING: f64 = 0.1;
/// Each curve alone may at first use this share of the tolerance, because the errors of many curves
/// partly cancel.
const FIRST: f64 = 0.4;
/// After this many rounds, a frame that is still off gets a key on the curve with the largest error
/// there.
const ROUNDS: usize = 8;
/// About this many vertices are measured at first. Once none of them is off, all are measured, and
/// those that are off join them.
const LOOKED_AT: usize = 1500;
/// Frames that one task measures together.
const BLOCK: usize = 64;

/// The fitted curves and their error.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceFit {
    /// One for each column of weights.
    pub curves: Vec<Curve>,
    /// The largest distance of any vertex from its place in any frame, in the unit of the shapes.
    pub error: f64,
}

/// Fits curves to the weights `[T, K]` of shapes `[K, V, 3]`. They keep every vertex within
/// `tolerance` of its place in every frame, and within a tenth of that in `touching` frames `[T]`.
/// A run of touching frames starts and ends with a key on every curve that moves the face by more
/// than the tolerance.
///
/// # Errors
/// `InvalidInput` if the lengths differ, the tolerance is not positive or a number is not finite;
/// `Cancelled`.
pub fn on_face(
    weights: ArrayView2<'_, f32>,
    shapes: ArrayView3<'_, f32>,
    tolerance: f64,
    touching: &[bool],
    progress: ProgressFn<'_>,
) -> Result<FaceFit> {
    let (frames, count) = weights.dim();
    if shapes.len_of(Axis(0)) != count {
        return Err(Error::InvalidInput(format!(
            "curves: expected {count} shapes, one for each column of weights, got {}",
            shapes.len_of(Axis(0))
        )));
    }
    if shapes.iter().any(|x| !x.is_finite()) {
        let message = "curves: expected finite shapes, got NaN or infinity";
        return Err(Error::InvalidInput(message.into()));
    }
    let column = |k: usize| weights.column(k).iter().map(|&w| f64::from(w)).collect();
    let columns: Vec<Vec<f64>> = (0..count).map(column).collect();
    let none = vec![0.0; frames];
    check(&none, &vec![tolerance; frames], touching)?;
    columns
        .iter()
        .try_for_each(|values| check(values, &vec![1.0; frames], touching))?;
    let mut job = Job::new(&columns, shapes, tolerance, touching);
    loop {
        report(
            progress,
            "curves",
            job.round.min(ROUNDS) as f32 / (ROUNDS + 1) as f32,
        )?;
        job.fit();
        let errors = job.errors(&job.some);
        if job.tighten(&errors) {
            continue;
        }
        let errors = job.errors(&job.every);
        if !job.tighten(&errors) {
            let error = errors.iter().map(|(error, _)| *error).fold(0.0, f64::max);
            let curves = job.curves;
            return Ok(FaceFit { curves, error });
        }
        job.measure_more(&errors);
    }
}

struct Job<'a> {
    columns: &'a [Vec<f64>],
    /// `[K, 3V]`: the shapes at all vertices.
    every: Array2<f32>,
    /// The vertices that are measured in every round, in ascending order.
    measured: Vec<usize>,
    /// The shapes at these.
    some: Array2<f32>,
    curves: Vec<Curve>,
    /// `[T, K]`: how far each curve misses its weight.
    missed: Array2<f32>,
    /// `[K]`: the error in weight with which a curve alone uses up the tolerance.
    limits: Vec<f64>,
    /// `[T]`: the share of its limit that a curve may use in a frame.
    shares: Vec<f64>,
    /// `[T]`: the tolerance of each frame.
    tolerances: Vec<f64>,
    /// `[T]`: the frames that must have a key on every curve in `moves`.
    fixed: Vec<bool>,
    /// `[K]`: whether a curve moves the face by more than the tolerance.
    moves: Vec<bool>,
    pinned: Vec<Vec<bool>>,
    round: usize,
}

impl<'a> Job<'a> {
    fn new(
        columns: &'a [Vec<f64>],
        shapes: ArrayView3<'_, f32>,
        tolerance: f64,
        touching: &[bool],
    ) -> Self {
        let (count, vertices, _) = shapes.dim();
        let every = shapes
            .to_shape((count, 3 * vertices))
            .expect("row-major")
            .into_owned();
        let step = (vertices / LOOKED_AT).max(1);
        let measured: Vec<usize> = (0..vertices).step_by(step).collect();
        let sizes: Vec<f64> = every
            .rows()
            .into_iter()
            .map(|row| farthest(row).0)
            .collect();
        let range = |values: &Vec<f64>| {
            let (low, high) = values
                .iter()
                .fold((0.0f64, 0.0f64), |(l, h), &x| (l.min(x), h.max(x)));
            high - low
        };
        let frames = touching.len();
        let ends = |t: usize| {
            let other = |at: Option<usize>| at.and_then(|at| touching.get(at)).is_none_or(|x| !x);
            touching[t] && (other(t.checked_sub(1)) || other(Some(t + 1)))
        };
        let share = |t: usize| if touching[t] { TOUCHING } else { 1.0 };
        Job {
            columns,
            some: columns_of(every.view(), &measured),
            measured,
            every,
            curves: vec![Vec::new(); count],
            missed: Array2::from_elem((frames, count), f32::INFINITY),
            limits: sizes
                .iter()
                .map(|size| tolerance / size.max(1e-12))
                .collect(),
            shares: (0..frames).map(|t| FIRST * share(t)).collect(),
            tolerances: (0..frames).map(|t| tolerance * share(t)).collect(),
            fixed: (0..frames).map(ends).collect(),
            moves: columns
                .iter()
                .zip(&sizes)
                .map(|(v, size)| range(v) * size > tolerance)
                .collect(),
            pinned: vec![vec![false; frames]; count],
            round: 0,
        }
    }

    /// Fits the curves that miss a weight by more than their limit, or lack a key.
    fn fit(&mut self) {
        let one = |k: usize| {
            let limit = |share: &f64| share * self.limits[k];
            let limits: Vec<f64> = self.shares.iter().map(limit).collect();
            let fixed = |(&fixed, &pinned): (&bool, &bool)| (fixed && self.moves[k]) || pinned;
            let fixed: Vec<bool> = self.fixed.iter().zip(&self.pinned[k]).map(fixed).collect();
            let missed = self.missed.column(k);
            let mut misses = missed.iter().zip(&limits);
            let curve = &self.curves[k];
            let lacks =
                |t: usize| fixed[t] && curve.binary_search_by_key(&t, |key| key.row).is_err();
            let misses = misses.any(|(missed, limit)| f64::from(missed.abs()) > *limit);
            (misses || (0..fixed.len()).any(lacks))
                .then(|| (k, fit_checked(&self.columns[k], &limits, &fixed)))
        };
        let fitted = (0..self.columns.len()).into_par_iter().filter_map(one);
        for (k, curve) in fitted.collect::<Vec<_>>() {
            let values = &self.columns[k];
            let missed = evaluate(values, &curve).into_iter().zip(values);
            for (to, (fitted, value)) in self.missed.column_mut(k).iter_mut().zip(missed) {
                *to = (fitted - value) as f32;
            }
            self.curves[k] = curve;
        }
    }

    /// For each frame the vertex of `shapes` `[K, 3N]` that is farthest from its place: its distance
    /// and its number among the `N`.
    fn errors(&self, shapes: &Array2<f32>) -> Vec<(f64, usize)> {
        let blocks: Vec<_> = self.missed.axis_chunks_iter(Axis(0), BLOCK).collect();
        let block = |rows: &ArrayView2<'_, f32>| {
            // The product for a single curve is column-major.
            let moved = rows.dot(shapes).as_standard_layout().into_owned();
            moved.rows().into_iter().map(farthest).collect::<Vec<_>>()
        };
        blocks.par_iter().flat_map(block).collect()
    }

    /// Measures the vertices of `errors` that are off in all further rounds. `errors`: of all
    /// vertices.
    fn measure_more(&mut self, errors: &[(f64, usize)]) {
        let off = errors.iter().zip(&self.tolerances);
        let off = off.filter(|((error, _), tolerance)| error > tolerance);
        self.measured.extend(off.map(|((_, vertex), _)| vertex));
        self.measured.sort_unstable();
        self.measured.dedup();
        self.some = columns_of(self.every.view(), &self.measured);
    }

    /// Lowers the limits in frames that are off. Returns whether there are any.
    fn tighten(&mut self, errors: &[(f64, usize)]) -> bool {
        self.round += 1;
        let mut off = false;
        for (t, (&(error, _), &tolerance)) in errors.iter().zip(&self.tolerances).enumerate() {
            if error <= tolerance {
                continue;
            }
            off = true;
            self.shares[t] *= (0.95 * tolerance / error).sqrt().clamp(0.5, 0.98);
            if self.round > ROUNDS {
                let far = |&k: &usize| f64::from(self.missed[[t, k]].abs()) / self.limits[k];
                let worst = (0..self.pinned.len()).max_by(|a, b| far(a).total_cmp(&far(b)));
                worst.into_iter().for_each(|k| self.pinned[k][t] = true);
            }
        }
        off
    }
}

/// The length of the longest of the vectors `[3V]`, and its number.
fn farthest(moved: ArrayView1<'_, f32>) -> (f64, usize) {
    let (square, number) = longest(moved.as_slice().expect("row-major"));
    (f64::from(square).sqrt(), number)
}
