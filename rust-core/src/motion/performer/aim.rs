//! How far beyond the person a fit has to aim to move as far as that person.
//!
//! Least squares moves a mouth less than its person does, by as much as the sound leaves unknown. It then follows
//! in time, but mumbles. Aimed at a person who moves further, it moves on parts left out as far as the person does,
//! with the same correlation.

use faer::{Mat, Side};
use ndarray::{Array1, Array2, ArrayView1, Axis, s};

/// How many directions of the person's motion are aimed at, the largest first.
const DIRECTIONS: usize = 8;
/// The furthest aim, in multiples of the person's own motion.
const FURTHEST: f64 = 2.0;
/// Directions in which parts left out follow the person with a smaller correlation are noise and stay.
const LEAST_R: f64 = 0.3;
/// How often the aim is corrected by what the fit on it leaves.
const ROUNDS: usize = 2;

/// What of the person's motion is to be added to the aim of a fit `[T, N]`. `person` `[T, N]`: the person's motion;
/// `lengths`: rows of each take, whose means count for nothing; `fit`: the motion on parts left out by a fit
/// with such an addition.
pub(super) fn beyond(
    person: &Array2<f32>,
    lengths: &[usize],
    fit: impl Fn(&Array2<f32>) -> Array2<f32>,
) -> Array2<f32> {
    let person = centred(person, lengths);
    let directions = directions(&person);
    let along = person.dot(&directions);
    let mut aims = Array1::from_elem(directions.ncols(), 1.0);
    let mut added = Array2::zeros(person.dim());
    for _ in 0..ROUNDS {
        let predicted = centred(&fit(&added), lengths).dot(&directions);
        for (k, aim) in aims.iter_mut().enumerate() {
            let (own, left_out) = (along.column(k), predicted.column(k));
            let sizes = product(own, own).sqrt() * product(left_out, left_out).sqrt();
            let r = product(own, left_out) / sizes.max(f64::MIN_POSITIVE);
            let ratio = (product(own, own) / product(left_out, left_out)).sqrt();
            *aim = if r > LEAST_R {
                (*aim * ratio).clamp(1.0, FURTHEST)
            } else {
                1.0
            };
        }
        let further = aims.mapv(|aim| (aim - 1.0) as f32);
        added = (&along * &further).dot(&directions.t());
    }
    added
}

/// Rows less the mean of their take.
fn centred(rows: &Array2<f32>, lengths: &[usize]) -> Array2<f32> {
    let (mut rows, mut first) = (rows.clone(), 0);
    for length in lengths {
        let mut take = rows.slice_mut(s![first..first + length, ..]);
        if let Some(mean) = take.mean_axis(Axis(0)) {
            take -= &mean;
        }
        first += length;
    }
    rows
}

fn product(a: ArrayView1<'_, f32>, b: ArrayView1<'_, f32>) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| f64::from(*a) * f64::from(*b))
        .sum()
}

/// The principal directions of rows `[T, N]`, columns of `[N, K]`. None for rows that are not finite.
fn directions(rows: &Array2<f32>) -> Array2<f32> {
    let gram = rows.t().dot(rows);
    let size = gram.nrows();
    let gram = Mat::from_fn(size, size, |i, j| f64::from(gram[[i, j]]));
    let Ok(eigen) = gram.self_adjoint_eigen(Side::Lower) else {
        return Array2::zeros((size, 0));
    };
    let vectors = eigen.U();
    let count = DIRECTIONS.min(size);
    // Eigenvalues rise.
    Array2::from_shape_fn((size, count), |(i, k)| vectors[(i, size - 1 - k)] as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion along one axis of which a fit knows the half.
    #[test]
    fn a_fit_that_knows_the_half_aims_twice_as_far_and_noise_stays() {
        let wave = |t: usize, rate: f32| (t as f32 * rate).sin();
        let person = Array2::from_shape_fn((400, 3), |(t, n)| match n {
            0 => 2.0 * wave(t, 0.3),
            1 => wave(t, 0.7),
            _ => 0.0,
        });
        let fit = |added: &Array2<f32>| {
            let mut seen = &person + added;
            seen.column_mut(0).mapv_inplace(|x| 0.6 * x);
            // Along the second axis it moves otherwise than the person.
            for (t, x) in seen.column_mut(1).iter_mut().enumerate() {
                *x = wave(t, 0.41);
            }
            seen
        };
        let moved = fit(&beyond(&person, &[150, 250], fit));
        let along = |rows: &Array2<f32>, n: usize| product(rows.column(n), rows.column(n)).sqrt();
        let ratio = along(&moved, 0) / along(&person, 0);
        assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
        let added = beyond(&person, &[150, 250], fit);
        assert!(along(&added, 1) < 0.02 * along(&person, 1));
    }
}
