//! Codes under which the landmarks of a head go where a performance puts them.
//!
//! Emotion, articulation, blinks and contacts are laid over the landmarks of a take. A surface moves by codes alone, so
//! each frame's code is led by its landmarks: damped least squares on those of the mean head, from the code that
//! was sampled.

use faer::{Mat, Side, linalg::solvers::Solve};
use ndarray::{Array2, ArrayView2, ArrayView3};

use super::{Head, Mover};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    mesh::ibug::LANDMARKS,
};

const COORDINATES: usize = 3 * LANDMARKS;
/// By so much a code changes to see what that does to landmarks.
const DIFFERENCE: f32 = 0.02;
/// Of the mean square of what a code does to landmarks, added for each code.
const DAMPING: f64 = 0.02;
const ROUNDS: usize = 4;

impl Head {
    /// Codes `[T, X]` near `codes` under which the landmarks of the mean head move as `landmarks` say, `[T, 68, 3]`
    /// canonical metres from rest, as nearly as codes can.
    ///
    /// # Errors
    /// `InvalidInput` for codes of another length, `Cancelled`.
    pub fn led_codes(
        &self,
        codes: ArrayView2<'_, f32>,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let (places, rest) = self.mean_landmarks()?;
        let pull = pull(&places, &self.rest_code(), &rest)?;
        let (mut led, frames) = (codes.to_owned(), codes.nrows());
        for (t, mut row) in led.outer_iter_mut().enumerate() {
            report(progress, "surface", t as f32 / frames as f32)?;
            for _ in 0..ROUNDS {
                let moved = places.at(&row.to_vec())?;
                let off = Mat::from_fn(COORDINATES, 1, |k, _| {
                    let (n, axis) = (k / 3, k % 3);
                    f64::from(rest[n][axis] + landmarks[[t, n, axis]] - moved[n][axis])
                });
                let step = &pull * off;
                row.indexed_iter_mut()
                    .for_each(|(x, value)| *value += step[(x, 0)] as f32);
            }
        }
        Ok(led)
    }
}

/// From what landmarks lack, metres, to changes of the codes that give it: `[X, 204]`, damped least squares about rest.
fn pull(places: &Mover<'_>, rest_code: &[f32], rest: &[[f32; 3]]) -> Result<Mat<f64>> {
    let mut columns = Vec::with_capacity(rest_code.len());
    for x in 0..rest_code.len() {
        let mut code = rest_code.to_vec();
        code[x] += DIFFERENCE;
        columns.push(places.at(&code)?);
    }
    let jacobian = Mat::from_fn(COORDINATES, columns.len(), |k, x| {
        let (n, axis) = (k / 3, k % 3);
        f64::from((columns[x][n][axis] - rest[n][axis]) / DIFFERENCE)
    });
    let mut normal = jacobian.transpose() * &jacobian;
    let mean = (0..columns.len()).map(|x| normal[(x, x)]).sum::<f64>() / columns.len() as f64;
    for x in 0..columns.len() {
        normal[(x, x)] += DAMPING * mean;
    }
    let factors = normal.llt(Side::Lower).map_err(|_| {
        Error::Numerics("codes that landmarks lead: expected a positive matrix, got none".into())
    })?;
    Ok(factors.solve(jacobian.transpose()))
}
