//! Codes that move a head's landmarks to where a performance puts them.
//!
//! Emotion, articulation, blinks and contacts are added to the landmarks of a take. A surface moves
//! by codes alone. So damped least squares fits each frame's code to the frame's landmarks,
//! starting from the sampled code. It compares the landmarks of the mean head.

use faer::{Mat, Side, linalg::solvers::Solve};
use ndarray::{Array2, ArrayView2, ArrayView3};

use super::{Head, Mover};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    mesh::ibug::LANDMARKS,
};

const COORDINATES: usize = 3 * LANDMARKS;
/// Change of each number of the code that measures its effect on the landmarks.
const DIFFERENCE: f32 = 0.02;
/// Damping of the least squares: this share of the normal matrix's mean diagonal is added to it.
const DAMPING: f64 = 0.02;
const ROUNDS: usize = 4;

impl Head {
    /// Codes `[T, X]` near `codes` that bring the landmarks of the mean head as close as possible
    /// to `landmarks`, `[T, 68, 3]` canonical metres from rest.
    ///
    /// # Errors
    /// `InvalidInput` for codes of another length; `Cancelled`.
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

/// Matrix `[X, 204]` that turns missing displacements of landmarks, metres, into changes of the
/// code: damped least squares, linear about rest.
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
        Error::Numerics(
            "codes of landmarks: expected a positive definite matrix, got another".into(),
        )
    })?;
    Ok(factors.solve(jacobian.transpose()))
}
