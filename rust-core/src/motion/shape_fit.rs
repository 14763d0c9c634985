//! Fits weights of shapes to landmarks, one frame at a time.
//!
//! Minimises squared errors with bounds and a memory of the previous frame:
//!
//! `|D w − x|² + Σ_s g_s (ρ w_s² + μ (w_s − w′_s)²) + σ Σ_pairs g (w_l − w_r)²` with `0 ≤ w ≤ 1`
//!
//! `D` are the shapes at the landmarks, `x` is a frame, `w′` are the weights of the previous frame,
//! and `g_s = |d_s|²`. The gaps between the lips count as well as the landmarks, because people
//! notice an open mouth that should be shut before anything else. Cyclic coordinate descent starts
//! from the weights of the previous frame. [`crate::rig::solve`] does the same for all frames at
//! once.

use ndarray::{Array2, Array3, ArrayView1};

use crate::mesh::ibug::{INNER_LIPS, LANDMARKS};

/// `ρ`, `μ` and `σ`.
const RIDGE: f64 = 1e-3;
const SMOOTHNESS: f64 = 0.02;
const SYMMETRY: f64 = 5e-3;
/// Factor on the gaps between the lips. A landmark coordinate has factor 1.
const GAP: f32 = 3.0;
/// The descent stops once no weight changes by more than this in a sweep.
const ARRIVED: f64 = 1e-5;
const MAX_SWEEPS: usize = 200;
const MM: f32 = 1e3;
/// The coordinates of the landmarks, and one gap for each inner pair of lip landmarks.
const ROWS: usize = 3 * LANDMARKS + INNER_LIPS.len();

/// Shapes at the landmarks, and the weights of the last frame.
pub(super) struct ShapeFit {
    /// `[S, ROWS]`, millimetres.
    shapes: Array2<f32>,
    /// `[S, S]`.
    gram: Array2<f64>,
    /// For each shape, its counterpart on the other side.
    mirror: Vec<Option<usize>>,
    /// `[S]`.
    last: Vec<f64>,
}

impl ShapeFit {
    /// `shapes`: `[S, 68, 3]`, canonical metres.
    pub(super) fn new(shapes: &Array3<f32>, mirror: Vec<Option<usize>>) -> ShapeFit {
        let count = shapes.dim().0;
        let mut rows = Array2::zeros((count, ROWS));
        for (mut row, shape) in rows.outer_iter_mut().zip(shapes.outer_iter()) {
            let shape = shape.as_standard_layout();
            row.assign(&measurements(shape.as_slice().expect("standard layout")));
        }
        let wide = rows.mapv(f64::from);
        ShapeFit {
            gram: wide.dot(&wide.t()),
            shapes: rows,
            mirror,
            last: vec![0.0; count],
        }
    }

    /// The weights `[S]` of the next frame. `frame`: `[204]`, canonical metres.
    pub(super) fn next(&mut self, frame: &[f32]) -> &[f64] {
        let measured = measurements(frame);
        let right: Vec<f64> = (self.shapes.outer_iter())
            .map(|shape| f64::from(dot(shape, measured.view())))
            .collect();
        let before = self.last.clone();
        for _ in 0..MAX_SWEEPS {
            let mut moved: f64 = 0.0;
            for s in 0..right.len() {
                let square = self.gram[[s, s]];
                if square < 1e-6 {
                    continue;
                }
                let row = self.gram.row(s);
                let all: f64 = row.iter().zip(&self.last).map(|(g, w)| g * w).sum();
                let others = all - square * self.last[s];
                let (mut pull, mut weight) =
                    (right[s] - others, square * (1.0 + RIDGE + SMOOTHNESS));
                pull += SMOOTHNESS * square * before[s];
                if let Some(other) = self.mirror[s] {
                    pull += SYMMETRY * square * self.last[other];
                    weight += SYMMETRY * square;
                }
                let best = (pull / weight).clamp(0.0, 1.0);
                moved = moved.max((best - self.last[s]).abs());
                self.last[s] = best;
            }
            if moved < ARRIVED {
                break;
            }
        }
        &self.last
    }
}

fn dot(a: ArrayView1<'_, f32>, b: ArrayView1<'_, f32>) -> f32 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The numbers of a frame `[204]` that the fit compares: its coordinates and the weighted gaps
/// between its lips, millimetres.
fn measurements(frame: &[f32]) -> ndarray::Array1<f32> {
    let gap = |&(upper, lower): &(usize, usize)| frame[3 * upper + 1] - frame[3 * lower + 1];
    let gaps = INNER_LIPS.iter().map(|pair| GAP * gap(pair));
    frame.iter().copied().chain(gaps).map(|x| MM * x).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two mirrored shapes that move one landmark each.
    fn fit() -> ShapeFit {
        let mut shapes = Array3::zeros((2, LANDMARKS, 3));
        shapes[[0, 48, 0]] = 0.01;
        shapes[[1, 54, 0]] = -0.01;
        ShapeFit::new(&shapes, vec![Some(1), Some(0)])
    }

    #[test]
    fn weights_follow_landmarks_within_their_bounds() {
        let mut fit = fit();
        let mut frame = [0.0; 3 * LANDMARKS];
        frame[3 * 48] = 0.005;
        frame[3 * 54] = -0.02;
        let weights = (0..20).map(|_| fit.next(&frame).to_vec()).last().unwrap();
        assert!(
            (weights[0] - 0.5).abs() < 0.02 && weights[1] == 1.0,
            "{weights:?}"
        );
        frame[3 * 48] = -0.005;
        let weights = fit.next(&frame);
        assert_eq!(weights[0], 0.0);
    }
}
