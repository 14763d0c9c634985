//! Keeps lips that speech closes closed under an expression.

use ndarray::{Array3, ArrayView2, ArrayViewMut2};

use crate::{
    mesh::ibug::LIP_COLUMNS,
    motion::{
        articulation::{closedness, keep_gap},
        contacts::TOUCHING_M,
    },
};

/// Lips that stay closed for longer than this are at rest, seconds: an expression may part them.
const REST_S: f64 = 0.6;
/// Standard deviation of the fade into rest and out of it, seconds.
const SETTLING_S: f64 = 0.08;
/// Standard deviation of the fade with which the parting of the lips yields to a closure, seconds.
const YIELDING_S: f64 = 0.05;

/// How much the lips of each frame speak, and how far they yield.
pub(super) struct Closures {
    /// `[T]`, 0 where the lips rest, 1 in speech.
    pub(super) speaking: Vec<f32>,
    /// `[T]`, 1 at a closure, with soft shoulders.
    pub(super) yielding: Vec<f32>,
}

impl Closures {
    /// Finds the closures of neutral speech `[T, 68, 3]`, canonical metres.
    pub(super) fn of(spoken: &Array3<f32>, fps: f64) -> Self {
        let frames = spoken.outer_iter();
        let closed: Vec<f32> = frames.map(|frame| closed_lips(frame.view())).collect();
        let reach = (0.5 * REST_S * fps).round() as usize;
        let resting = gaussian(&extreme(&closed, reach, f32::min), SETTLING_S * fps);
        let speaking: Vec<f32> = resting.iter().map(|resting| 1.0 - resting).collect();
        let brief: Vec<f32> = closed.iter().zip(&speaking).map(|(c, s)| c * s).collect();
        let near = (YIELDING_S * fps).round() as usize;
        let yielding = gaussian(&extreme(&brief, near, f32::max), YIELDING_S * fps);
        Closures { speaking, yielding }
    }
}

/// How nearly the lips are closed, 0 to 1, at the pair with the smallest gap.
pub(super) fn closed_lips(frame: ArrayView2<'_, f32>) -> f32 {
    let gaps = LIP_COLUMNS.iter().map(|column| {
        let (up, low) = (column.upper[0].0, column.lower[0].0);
        frame[[up, 1]] - frame[[low, 1]]
    });
    gaps.map(closedness).fold(0.0, f32::max)
}

/// Gives `frame` the gaps of `spoken` where `spoken` closes the lips in speech. Lips overlap no deeper
/// than when they touch, or than in `spoken`. Both `[68, 3]`, canonical metres.
pub(super) fn hold(frame: &mut ArrayViewMut2<'_, f32>, spoken: ArrayView2<'_, f32>, speaking: f32) {
    keep_gap(frame, spoken, |gap| speaking * closedness(gap), TOUCHING_M);
}

/// The least or largest value within `reach` frames of each value; ends are held.
fn extreme(values: &[f32], reach: usize, of: fn(f32, f32) -> f32) -> Vec<f32> {
    let window = |t: usize| &values[t.saturating_sub(reach)..(t + reach + 1).min(values.len())];
    (0..values.len())
        .map(|t| window(t).iter().copied().reduce(of).unwrap_or(0.0))
        .collect()
}

/// Gaussian smoothing. `deviation`: standard deviation in frames; ends are held.
fn gaussian(values: &[f32], deviation: f64) -> Vec<f32> {
    let reach = (3.0 * deviation).ceil() as isize;
    let weight = |k: isize| (-0.5 * (k as f64 / deviation.max(1e-9)).powi(2)).exp();
    let total: f64 = (-reach..=reach).map(weight).sum();
    let last = values.len() as isize - 1;
    let at = |t: isize| f64::from(values[t.clamp(0, last) as usize]);
    (0..=last)
        .map(|t| (-reach..=reach).map(|k| weight(k) * at(t + k)).sum::<f64>() / total)
        .map(|x| x as f32)
        .collect()
}
