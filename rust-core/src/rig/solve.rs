//! Solves for the weights of shapes that show any motion of vertices.
//!
//! Least squares with bounds and a memory, over all frames `t` together:
//!
//! `Σ_t |D w_t − x_t|² + Σ_t Σ_s g_s (ρ w_ts² + μ (w_ts − w_t−1,s)²) + σ Σ_t Σ_pairs g (w_tl − w_tr)²`
//! ` + λ Σ_t Σ_s 2 g_s w_ts` with `0 ≤ w ≤ 1`
//!
//! `D` are the shapes, `x_t` the displacements and `g_s = |d_s|²`, so that every term has the same
//! unit. Where lips meet, their gap counts too ([`super::closures`]).
//!
//! 1. The motion enters only through `Dᵀ x_t` and `|x_t|²`. [`FRAMES_PER_BLOCK`] frames at a time
//!    are multiplied with the shapes, and the shapes with one another. This costs
//!    `3 V S (T + S)` products. From here on V no longer matters.
//! 2. Cyclic coordinate descent with clamping (Bertsekas 1999, §2.7) sweeps over the frames,
//!    forwards and backwards in turn. Each weight goes [`RELAXATION`] times the way to its best
//!    value while all others stay, and is clamped to 0 and 1. Going beyond the best value saves a
//!    fifth of the sweeps.
//! 3. If only one of two shapes that undo each other may move, [`opposing::resting`] chooses which
//!    one rests in a frame. Its weight becomes 0, and the descent continues from there without it.
//!
//! Each weight that changes updates the slopes `[T, S]` of its frame, which costs S products. A
//! weight that does not change, as most at a bound, costs one comparison. The memory `μ` couples a
//! frame only to the frames before and after it. So a sweep skips a frame if neither the frame nor
//! its neighbours changed by [`ARRIVED`] in their last visits, and most sweeps visit only the few
//! frames that still change. Changes too small to wake a frame could add up. The descent therefore
//! ends only after a sweep that visits all frames and changes no weight by [`ARRIVED`].
//!
//! With `ρ > 0` the problem is strictly convex, so the descent converges to its only minimum.
//! Neither chance nor the number of threads changes the result. In step 3 this holds for each of
//! the two descents, but the first one determines which shapes rest in the second.
//!
//! What can go wrong: after [`MAX_SWEEPS`] the descent returns the weights it has, still within
//! the bounds. A shape that hardly moves anything would cause a division by nearly 0, so its weight
//! stays 0. If motion is not finite or too large for single precision, the error names its frame.
//! The residual comes from `|x|² − 2 w Dᵀ x + w Dᵀ D w` alone. If the fit is nearly exact, this is
//! a difference of large numbers, so values below 0 become 0.

use ndarray::{Array2, ArrayView3, Axis, aview1};

use super::{
    closures::{Closures, gaps},
    mirrored_name, opposing,
};
use crate::{
    Error, Result,
    face::Rig,
    job::{ProgressFn, report},
    nn::{finite::check_result, matrix},
};

/// A shape with less than this share of the mean energy keeps the weight 0.
const STILL_SHARE: f64 = 1e-7;
/// The descent ends when no weight changes by this much in a sweep over all frames.
const ARRIVED: f64 = 1e-6;
/// The most sweeps of a descent.
const MAX_SWEEPS: usize = 3000;
/// `ω`: each step goes this multiple of the way to the best value of its weight. Over-relaxation
/// saves a fifth of the sweeps and converges for every `0 < ω < 2` (Cryer 1971).
const RELAXATION: f64 = 1.2;
/// Frames that are multiplied with the shapes at a time.
const FRAMES_PER_BLOCK: usize = 32;

/// The terms of a solve in addition to the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveOptions {
    /// `ρ`: pulls weights towards 0, which decides between shapes that do the same.
    pub ridge: f64,
    /// `μ`: pulls weights towards those of the frames before and after.
    pub smoothness: f64,
    /// `σ`: pulls left and right weights towards each other.
    pub symmetry: f64,
    /// `λ`: favours few shapes at a time.
    pub sparsity: f64,
    /// Whether only one of two shapes that undo each other moves at a time.
    pub exclusive: bool,
}

impl Default for SolveOptions {
    fn default() -> Self {
        SolveOptions {
            ridge: 1e-4,
            smoothness: 0.02,
            symmetry: 1e-3,
            sparsity: 0.0,
            exclusive: false,
        }
    }
}

impl SolveOptions {
    /// For artists who edit the weights one by one: few shapes at a time, both sides alike, and
    /// only one of two shapes that undo each other. It costs one or two percent of the motion.
    pub fn editable() -> Self {
        SolveOptions {
            symmetry: 0.2,
            sparsity: 2e-3,
            exclusive: true,
            ..SolveOptions::default()
        }
    }
}

/// Weights over time, and the motion that they leave unexplained.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedWeights {
    /// `[S]`, names of the shapes.
    pub names: Vec<String>,
    /// `[T, S]`, 0 to 1.
    pub weights: Array2<f32>,
    /// `[T]`, root mean square over vertices of the remaining motion, mesh units.
    pub residual: Vec<f32>,
    /// `[T]`, root mean square over vertices of the motion, mesh units.
    pub motion: Vec<f32>,
}

impl SolvedWeights {
    /// Weights `[T, S]` that come from no solve, so they leave no motion unexplained.
    pub fn exact(names: Vec<String>, weights: Array2<f32>) -> SolvedWeights {
        let still = vec![0.0; weights.nrows()];
        SolvedWeights {
            names,
            weights,
            residual: still.clone(),
            motion: still,
        }
    }
}

/// Solves for the weights of the first `shapes` shapes of `rig`.
///
/// `displacements`: `[T, V, 3]`, of the same mesh and in the same units, without motion of the
/// whole head. `lips`: `[N]` pairs of an upper and a lower lip vertex that meet, possibly none. In
/// frames whose motion closes the lips, the shapes close them too, as well as they can.
///
/// # Errors
/// `ShapeMismatch` if the number of vertices differs, `InvalidInput` for motion that is not finite
/// or too large, a lip vertex or an option out of range, or a rig in which nothing moves;
/// `Cancelled`.
pub fn solve(
    rig: &Rig,
    shapes: usize,
    displacements: ArrayView3<'_, f32>,
    lips: &[[u32; 2]],
    options: &SolveOptions,
    progress: ProgressFn<'_>,
) -> Result<SolvedWeights> {
    options.check()?;
    check_motion(rig, displacements, lips)?;
    let (frames, vertices, _) = displacements.dim();
    let shapes = shapes.min(rig.names.len());
    report(progress, "solve", 0.0)?;
    let shown = rig.deltas.slice(ndarray::s![..shapes, .., ..]);
    let solver = ShapeSolver::new(&rig.names[..shapes], shown, lips);
    let deltas = rows_of(shown);
    let (mut right, mut energy) = (Array2::zeros((frames, shapes)), vec![0.0; frames]);
    for first in (0..frames).step_by(FRAMES_PER_BLOCK) {
        let last = (first + FRAMES_PER_BLOCK).min(frames);
        let block = rows_of(displacements.slice(ndarray::s![first..last, .., ..]));
        for (t, row) in block.rows().into_iter().enumerate() {
            energy[first + t] = row.iter().map(|x| f64::from(*x).powi(2)).sum();
        }
        right
            .slice_mut(ndarray::s![first..last, ..])
            .assign(&products(&block, &deltas));
        report(progress, "solve", 0.5 * last as f32 / frames as f32)?;
    }
    check_sums(&energy, &right)?;
    let problem = solver.problem(right, &gaps(lips, displacements), options)?;
    let weights = problem.solve(options.exclusive, progress)?;
    let solved = SolvedWeights {
        names: rig.names[..shapes].to_vec(),
        residual: problem.residuals(&weights, &energy, vertices),
        motion: energy
            .iter()
            .map(|x| (x / vertices as f64).sqrt() as f32)
            .collect(),
        weights: weights.mapv(|x| x as f32),
    };
    check_result("weights", solved.weights.view().into_dyn())?;
    for rest in [&solved.residual, &solved.motion] {
        check_result("residual", aview1(rest).into_dyn())?;
    }
    Ok(solved)
}

/// Checks that the motion and the lips fit the rig's mesh.
fn check_motion(rig: &Rig, displacements: ArrayView3<'_, f32>, lips: &[[u32; 2]]) -> Result<()> {
    let (frames, vertices, axes) = displacements.dim();
    let expected = rig.deltas.dim().1;
    if (vertices, axes) != (expected, 3) {
        return Err(Error::ShapeMismatch {
            what: "animation",
            expected: format!("[T, {expected}, 3], the rig's vertices"),
            got: format!("[{frames}, {vertices}, {axes}]"),
        });
    }
    match lips.iter().flatten().find(|lip| **lip as usize >= vertices) {
        None => Ok(()),
        Some(lip) => Err(Error::InvalidInput(format!(
            "lips: expected vertices below {vertices}, got {lip}"
        ))),
    }
}

/// Refuses motion whose energy `[T]` or products with the shapes `[T, S]` are not finite.
fn check_sums(energy: &[f64], products: &Array2<f64>) -> Result<()> {
    if let Some(frame) = energy.iter().position(|x| !x.is_finite()) {
        return Err(Error::InvalidInput(format!(
            "animation: expected finite numbers, got NaN or infinity in frame {frame}"
        )));
    }
    let mut rows = products.rows().into_iter();
    match rows.position(|row| row.iter().any(|x| !x.is_finite())) {
        None => Ok(()),
        Some(frame) => Err(Error::InvalidInput(format!(
            "animation: expected motion of the size of a face, got more than single precision holds in frame \
             {frame}"
        ))),
    }
}

/// `[N, V, 3]` as rows `[N, 3 V]`.
fn rows_of(displacements: ArrayView3<'_, f32>) -> Array2<f32> {
    let (rows, vertices, axes) = displacements.dim();
    let flat = displacements.to_shape((rows, vertices * axes));
    flat.expect("row-major array").into_owned()
}

/// The shapes, prepared once to solve for any number of motions.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShapeSolver {
    names: Vec<String>,
    /// `[S, S]`, products of the shapes with each other.
    gram: Array2<f64>,
    /// `[S, 3 N]`, how the shapes change the gaps between the lips.
    gaps: Array2<f64>,
}

impl ShapeSolver {
    /// `deltas`: `[S, V, 3]`. `lips`: `[N]` pairs of an upper and a lower lip vertex that meet.
    pub(crate) fn new(
        names: &[String],
        deltas: ArrayView3<'_, f32>,
        lips: &[[u32; 2]],
    ) -> ShapeSolver {
        let flat = rows_of(deltas);
        ShapeSolver {
            names: names.to_vec(),
            gram: products(&flat, &flat),
            gaps: gaps(lips, deltas),
        }
    }

    /// Some of the shapes, by their numbers.
    pub(crate) fn select(&self, shapes: &[usize]) -> ShapeSolver {
        let names = shapes.iter().map(|&s| self.names[s].clone());
        let gram = self.gram.select(Axis(0), shapes).select(Axis(1), shapes);
        ShapeSolver {
            names: names.collect(),
            gram: gram.as_standard_layout().into_owned(),
            gaps: self.gaps.select(Axis(0), shapes),
        }
    }

    /// Subtracts the motion that `weights` `[T, S]` make from `motion`.
    pub(crate) fn take_out(&self, weights: &Array2<f64>, motion: &mut MotionSums) {
        motion.products -= &weights.dot(&self.gram);
        motion.gaps -= &weights.dot(&self.gaps);
    }

    /// Solves for the weights `[T, S]` of a motion.
    ///
    /// # Errors
    /// Those of [`solve`] for options, a rig in which nothing moves and motion that is not finite;
    /// `Cancelled`.
    pub(crate) fn weights(
        &self,
        motion: MotionSums,
        options: &SolveOptions,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        options.check()?;
        let problem = self.problem(motion.products, &motion.gaps, options)?;
        let weights = problem.solve(options.exclusive, progress)?;
        let weights = weights.mapv(|x| x as f32);
        check_result("weights", weights.view().into_dyn())?;
        Ok(weights)
    }

    fn problem(
        &self,
        right: Array2<f64>,
        gaps: &Array2<f64>,
        options: &SolveOptions,
    ) -> Result<Problem> {
        let closures = Closures::of(&self.gaps, gaps, &self.gram);
        Problem::new(self.gram.clone(), right, closures, &self.names, options)
    }
}

/// All that a solve needs of a motion.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MotionSums {
    /// `[T, S]`, products of frames and shapes.
    pub products: Array2<f64>,
    /// `[T, 3 N]`, [`gaps`] between the lips.
    pub gaps: Array2<f64>,
}

impl SolveOptions {
    fn check(&self) -> Result<()> {
        for (name, value) in [
            ("ridge", self.ridge),
            ("smoothness", self.smoothness),
            ("symmetry", self.symmetry),
            ("sparsity", self.sparsity),
        ] {
            if !(0.0..=1e6).contains(&value) {
                return Err(Error::InvalidInput(format!(
                    "{name}: expected 0 to 1000000, got {value}"
                )));
            }
        }
        Ok(())
    }
}

/// `a bᵀ`, rows of `a` by rows of `b`.
fn products(a: &Array2<f32>, b: &Array2<f32>) -> Array2<f64> {
    let out = matrix::by_row_blocks(a.nrows(), b.nrows(), |rows, out| {
        let a = matrix::view(a).subrows(rows.start, rows.len());
        matrix::product(
            matrix::view_mut(out, b.nrows()),
            a,
            matrix::view(b).transpose(),
        );
    });
    out.mapv(f64::from)
}

/// The normal equations, all in units of the mean energy of a shape.
struct Problem {
    /// `[S, S]`, the fit alone.
    gram: Array2<f64>,
    /// `[S, S]`, with ridge and symmetry.
    matrix: Array2<f64>,
    /// `[T, S]`.
    right: Array2<f64>,
    closures: Option<Closures>,
    /// `[S]`, `μ g_s`, which is 0 for shapes that move nothing.
    memory: Vec<f64>,
    /// `[S]`, `λ g_s`.
    price: Vec<f64>,
    /// Pairs of shapes that undo each other.
    opposing: Vec<(usize, usize)>,
    /// Numbers of the shapes that move.
    moving: Vec<usize>,
    unit: f64,
}

impl Problem {
    fn new(
        mut gram: Array2<f64>,
        mut right: Array2<f64>,
        mut closures: Option<Closures>,
        names: &[String],
        options: &SolveOptions,
    ) -> Result<Problem> {
        let shapes = gram.nrows();
        let unit = gram.diag().sum() / shapes.max(1) as f64;
        if !(unit.is_finite() && unit > 0.0) {
            return Err(Error::InvalidInput(
                "rig: expected shapes that move the face, got none".into(),
            ));
        }
        gram /= unit;
        right /= unit;
        if let Some(closures) = &mut closures {
            closures.divide(unit);
        }
        let mut matrix = gram.clone();
        for s in 0..shapes {
            matrix[[s, s]] += options.ridge * gram[[s, s]];
            let mirrored = mirrored_name(&names[s]);
            let other = names.iter().position(|name| *name == mirrored);
            if let Some(other) = other.filter(|&other| pairs(&names[s]) && other != s) {
                let strength = options.symmetry * 0.5 * (gram[[s, s]] + gram[[other, other]]);
                matrix[[s, s]] += strength;
                matrix[[s, other]] -= strength;
            }
        }
        Ok(Problem {
            closures,
            price: gram.diag().iter().map(|g| options.sparsity * g).collect(),
            opposing: opposing::pairs(names, &gram),
            memory: gram.diag().iter().map(|g| options.smoothness * g).collect(),
            moving: (0..shapes)
                .filter(|&s| gram[[s, s]] > STILL_SHARE)
                .collect(),
            gram,
            matrix,
            right,
            unit,
        })
    }

    /// Solves for the weights. If `exclusive`, solves again with one shape of each opposing pair at
    /// 0.
    fn solve(&self, exclusive: bool, progress: ProgressFn<'_>) -> Result<Array2<f64>> {
        let mut weights = Array2::zeros(self.right.dim());
        let mut rests = Array2::from_elem(self.right.dim(), false);
        self.descend(&mut weights, &rests, progress)?;
        if exclusive && !self.opposing.is_empty() {
            rests = opposing::resting(&self.opposing, &weights, &self.gram);
            weights.zip_mut_with(&rests, |weight, &rest| {
                if rest {
                    *weight = 0.0;
                }
            });
            self.descend(&mut weights, &rests, progress)?;
        }
        Ok(weights)
    }

    /// Sweeps forwards and backwards over the frames until no weight changes any more. Weights that
    /// `rests` marks stay unchanged.
    fn descend(
        &self,
        weights: &mut Array2<f64>,
        rests: &Array2<bool>,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let frames = self.right.nrows();
        let mut slopes = self.slopes(weights);
        // A frame is skipped while neither it nor its neighbours change. The last sweep visits all.
        let mut changes = vec![f64::INFINITY; frames];
        let mut all = true;
        for sweep in 0..MAX_SWEEPS {
            let mut change = 0.0f64;
            for step in 0..frames {
                let t = if sweep % 2 == 0 {
                    step
                } else {
                    frames - 1 - step
                };
                let near = &changes[t.saturating_sub(1)..(t + 2).min(frames)];
                if all || near.iter().any(|change| *change >= ARRIVED) {
                    changes[t] = self.descend_frame(t, weights, rests, &mut slopes);
                    change = change.max(changes[t]);
                }
            }
            if change < ARRIVED && all {
                break;
            }
            all = change < ARRIVED;
            let done = 1.0 - 1.0 / (1.0 + sweep as f32);
            report(progress, "solve", 0.5 + 0.5 * done)?;
        }
        Ok(())
    }

    /// Slopes `[T, S]` at `weights` of all terms except the memory, which couples frames.
    fn slopes(&self, weights: &Array2<f64>) -> Array2<f64> {
        let mut slopes = weights.dot(&self.matrix) - &self.right;
        slopes += &aview1(&self.price);
        if let Some(closures) = &self.closures {
            let shares = aview1(&closures.shares).insert_axis(Axis(1));
            slopes += &((weights.dot(&closures.gram) - &closures.right) * shares);
        }
        slopes.as_standard_layout().into_owned()
    }

    /// Moves each weight of one frame in turn to its best value and beyond, see [`RELAXATION`].
    /// Returns the largest change. A weight that does not change, as most that are 0, costs only a
    /// comparison, since only changed weights update the slopes.
    fn descend_frame(
        &self,
        t: usize,
        weights: &mut Array2<f64>,
        rests: &Array2<bool>,
        slopes: &mut Array2<f64>,
    ) -> f64 {
        let (frames, count) = weights.dim();
        let row_of = |s: usize| s * count..(s + 1) * count;
        let matrix = self.matrix.as_slice().expect("row-major array");
        let closing = self.closures.as_ref().map(|c| (&c.gram, c.shares[t]));
        let closing = closing.filter(|(_, share)| *share != 0.0);
        let slopes = slopes.row_mut(t).into_slice().expect("row-major array");
        let all = weights.as_slice_mut().expect("row-major array");
        let (before, rest) = all.split_at_mut(t * count);
        let (now, after) = rest.split_at_mut(count);
        let before = (t > 0).then(|| &before[before.len() - count..]);
        let after = (t + 1 < frames).then(|| &after[..count]);
        let mut largest = 0.0f64;
        for &s in self.moving.iter().filter(|&&s| !rests[[t, s]]) {
            let row = &matrix[row_of(s)];
            let (mut gradient, mut slope) = (slopes[s], row[s]);
            if let Some((gram, share)) = closing {
                slope += share * gram[[s, s]];
            }
            for beside in [before, after].into_iter().flatten() {
                gradient += self.memory[s] * (now[s] - beside[s]);
                slope += self.memory[s];
            }
            let better = (now[s] - RELAXATION * gradient / slope).clamp(0.0, 1.0);
            let step = better - now[s];
            if step == 0.0 {
                continue;
            }
            largest = largest.max(step.abs());
            now[s] = better;
            add_scaled(slopes, step, row);
            if let Some((gram, share)) = closing {
                let row = &gram.as_slice().expect("row-major array")[row_of(s)];
                add_scaled(slopes, share * step, row);
            }
        }
        largest
    }

    /// `|x − D w|` of each frame, from the normal equations alone.
    fn residuals(&self, weights: &Array2<f64>, energy: &[f64], vertices: usize) -> Vec<f32> {
        let fitted = weights.dot(&self.gram);
        weights
            .axis_iter(Axis(0))
            .enumerate()
            .map(|(t, w)| {
                let explained = 2.0 * w.dot(&self.right.row(t)) - w.dot(&fitted.row(t));
                ((energy[t] - self.unit * explained).max(0.0) / vertices as f64).sqrt() as f32
            })
            .collect()
    }
}

/// `to += factor · row`, over plain slices. A solve spends most of its time here.
fn add_scaled(to: &mut [f64], factor: f64, row: &[f64]) {
    let row = &row[..to.len()];
    for i in 0..to.len() {
        to[i] += factor * row[i];
    }
}

/// Whether a shape and its mirror image tend to move together. Shapes that move to one side do not.
fn pairs(name: &str) -> bool {
    !["jawLeft", "jawRight", "mouthLeft", "mouthRight"].contains(&name)
        && !name.starts_with("eyeLookIn")
        && !name.starts_with("eyeLookOut")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{job::SILENT, rig::ARKIT};
    use ndarray::Array3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// 52 smooth shapes that overlap with some of the others.
    fn rig(vertices: usize) -> Rig {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let middle: Vec<f32> = ARKIT.iter().map(|_| rng.random_range(0.0..1.0)).collect();
        let turn: Vec<f32> = ARKIT.iter().map(|_| rng.random_range(0.0..6.0)).collect();
        let deltas = Array3::from_shape_fn((52, vertices, 3), |(s, v, i)| {
            let place = v as f32 / vertices as f32 - middle[s];
            (-place * place / 3e-4).exp() * (turn[s] + i as f32).sin()
        });
        Rig {
            names: ARKIT.map(str::to_owned).to_vec(),
            deltas,
            reports: Vec::new(),
        }
    }

    /// A few shapes at a time, coming and going slowly. `[T, 52]`.
    fn performance(frames: usize) -> Array2<f32> {
        Array2::from_shape_fn((frames, 52), |(t, s)| {
            let phase = t as f32 * 0.08 + s as f32;
            if s % 4 == 0 {
                0.5 + 0.5 * phase.sin()
            } else {
                0.0
            }
        })
    }

    fn play(rig: &Rig, weights: &Array2<f32>) -> Array3<f32> {
        let (shapes, vertices, _) = rig.deltas.dim();
        let flat = rig
            .deltas
            .to_shape((shapes, 3 * vertices))
            .unwrap()
            .into_owned();
        let moved = weights.dot(&flat);
        moved
            .into_shape_with_order((weights.nrows(), vertices, 3))
            .unwrap()
    }

    fn rms(a: &Array2<f32>, b: &Array2<f32>) -> f32 {
        ((a - b).mapv(|x| x * x).sum() / a.len() as f32).sqrt()
    }

    #[test]
    fn known_weights_come_back_within_two_hundredths() {
        let rig = rig(2000);
        let truth = performance(60);
        let options = SolveOptions {
            smoothness: 1e-4,
            ..SolveOptions::default()
        };
        let got = solve(&rig, 52, play(&rig, &truth).view(), &[], &options, SILENT).unwrap();
        assert!(
            rms(&got.weights, &truth) < 0.02,
            "{}",
            rms(&got.weights, &truth)
        );
        for (left, moved) in got.residual.iter().zip(&got.motion) {
            assert!(*left < 0.02 * moved);
        }
    }

    #[test]
    fn of_shapes_that_undo_each_other_one_at_a_time_moves() {
        let mut rig = rig(500);
        let at = |name: &str| ARKIT.iter().position(|n| *n == name).unwrap();
        let (left, right) = (at("mouthLeft"), at("mouthRight"));
        let against = rig.deltas.index_axis(Axis(0), left).mapv(|x| -0.9 * x);
        rig.deltas.index_axis_mut(Axis(0), right).assign(&against);
        let mut truth = Array2::zeros((60, 52));
        for t in 0..60 {
            truth[[t, left]] = 0.5 + 0.3 * (t as f32 * 0.1).sin();
            truth[[t, right]] = 0.5 - 0.3 * (t as f32 * 0.1).sin();
        }
        let moved = play(&rig, &truth);
        let ask = |exclusive| {
            let options = SolveOptions {
                exclusive,
                ridge: 0.0,
                ..SolveOptions::default()
            };
            solve(&rig, 52, moved.view(), &[], &options, SILENT).unwrap()
        };
        let got = ask(true);
        for t in 0..60 {
            let (a, b) = (got.weights[[t, left]], got.weights[[t, right]]);
            assert!(a == 0.0 || b == 0.0, "frame {t}: {a} and {b}");
            let net = truth[[t, left]] - 0.9 * truth[[t, right]];
            assert!(
                (a - 0.9 * b - net).abs() < 0.05,
                "frame {t}: {a} - {b} for {net}"
            );
        }
        assert!(got.weights.column(left).iter().any(|&w| w > 0.2));
        assert!(got.weights.column(right).iter().any(|&w| w > 0.2));
    }

    #[test]
    fn bounds_hold_where_the_motion_asks_for_more() {
        let rig = rig(500);
        let wild = performance(20).mapv(|x| 4.0 * x - 2.0);
        let got = solve(
            &rig,
            52,
            play(&rig, &wild).view(),
            &[],
            &SolveOptions::default(),
            SILENT,
        );
        let weights = got.unwrap().weights;
        assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
        assert!(weights.iter().any(|w| *w == 1.0) && weights.iter().any(|w| *w == 0.0));
    }

    #[test]
    fn noise_of_a_frame_is_smoothed_away() {
        let rig = rig(500);
        let truth = performance(60);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut noisy = truth.clone();
        noisy.mapv_inplace(|x| x + rng.random_range(-0.2..0.2f32));
        let moved = play(&rig, &noisy);
        let roughness = |smoothness: f64| {
            let options = SolveOptions {
                smoothness,
                ..SolveOptions::default()
            };
            let w = solve(&rig, 52, moved.view(), &[], &options, SILENT)
                .unwrap()
                .weights;
            let jumps = &w.slice(ndarray::s![1.., ..]) - &w.slice(ndarray::s![..-1, ..]);
            (jumps.mapv(|x| x * x).sum(), rms(&w, &truth))
        };
        let (rough, far) = roughness(0.0);
        let (smooth, near) = roughness(1.0);
        assert!(
            smooth < 0.2 * rough && near < far,
            "{smooth} {rough} {near} {far}"
        );
    }

    #[test]
    fn sides_that_cannot_be_told_apart_share_the_motion() {
        let mut rig = rig(200);
        let left = ARKIT.iter().position(|n| *n == "eyeBlinkLeft").unwrap();
        let right = ARKIT.iter().position(|n| *n == "eyeBlinkRight").unwrap();
        let same = rig.deltas.index_axis(Axis(0), left).to_owned();
        rig.deltas.index_axis_mut(Axis(0), right).assign(&same);
        let mut truth = Array2::zeros((4, 52));
        truth.column_mut(left).fill(0.8);
        let moved = play(&rig, &truth);
        let got = solve(
            &rig,
            52,
            moved.view(),
            &[],
            &SolveOptions::default(),
            SILENT,
        )
        .unwrap();
        let (a, b) = (got.weights[[2, left]], got.weights[[2, right]]);
        assert!(
            (a - b).abs() < 5e-3 && (a + b - 0.8).abs() < 0.05,
            "{a} {b}"
        );
    }

    #[test]
    fn wrong_sizes_and_broken_numbers_are_named() {
        let rig = rig(100);
        let ask = |moved: Array3<f32>| {
            solve(
                &rig,
                52,
                moved.view(),
                &[],
                &SolveOptions::default(),
                SILENT,
            )
            .unwrap_err()
            .to_string()
        };
        let wrong = ask(Array3::zeros((2, 99, 3)));
        assert!(wrong.contains("100") && wrong.contains("99"), "{wrong}");
        let mut broken = Array3::zeros((3, 100, 3));
        broken[[1, 0, 0]] = f32::NAN;
        assert!(ask(broken).contains("frame 1"));
        let still = Rig {
            deltas: Array3::zeros((52, 100, 3)),
            ..rig.clone()
        };
        let options = SolveOptions::default();
        assert!(
            solve(
                &still,
                52,
                Array3::zeros((1, 100, 3)).view(),
                &[],
                &options,
                SILENT
            )
            .is_err()
        );
    }

    /// Five shapes that all part the lips. The motion makes the lips meet in frames 8 to 11.
    #[test]
    fn lips_that_meet_meet_with_shapes_that_only_open() {
        let (upper, lower, vertices) = (0usize, 1usize, 60usize);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let deltas = Array3::from_shape_fn((5, vertices, 3), |(s, v, axis)| match (v, axis) {
            (0, 1) => 0.1,
            (1, 1) => -0.5 - 0.1 * s as f32,
            _ => rng.random_range(-0.5..0.5f32),
        });
        let names = [
            "jawOpen",
            "mouthFunnel",
            "mouthPucker",
            "mouthShrugLower",
            "mouthShrugUpper",
        ];
        let rig = Rig {
            names: names.map(str::to_owned).to_vec(),
            deltas,
            reports: Vec::new(),
        };
        let closed = |t: usize| (8..12).contains(&t);
        // While the lips meet, the rest of the face still moves, which the shapes cannot show
        // without parting the lips.
        let truth = Array2::from_shape_fn((20, 5), |(t, s)| 0.3 + 0.04 * ((t + 3 * s) % 10) as f32);
        let mut moved = play(&rig, &truth);
        for t in (0..20).filter(|&t| closed(t)) {
            moved.slice_mut(ndarray::s![t, ..2, ..]).fill(0.0);
        }
        let gaps = |lips: &[[u32; 2]]| -> Vec<f32> {
            let options = SolveOptions::editable();
            let got = solve(&rig, 5, moved.view(), lips, &options, SILENT).unwrap();
            let shown = play(&rig, &got.weights);
            (0..20)
                .map(|t| shown[[t, upper, 1]] - shown[[t, lower, 1]])
                .collect()
        };
        let (before, after) = (gaps(&[]), gaps(&[[0, 1]]));
        let open = (0..20)
            .filter(|&t| !closed(t))
            .map(|t| after[t])
            .fold(f32::MAX, f32::min);
        for t in 8..12 {
            assert!(before[t] > 0.3, "without lips: {}", before[t]);
            assert!(after[t] < 0.1 * open, "frame {t}: {} of {open}", after[t]);
        }
        for t in (0..20).filter(|t| !(5..15).contains(t)) {
            assert!(
                (after[t] - before[t]).abs() < 0.02 * before[t],
                "elsewhere nothing changes"
            );
        }
        let beyond = solve(
            &rig,
            5,
            moved.view(),
            &[[0, 60]],
            &SolveOptions::default(),
            SILENT,
        );
        assert!(beyond.unwrap_err().to_string().contains("below 60, got 60"));
    }
}
