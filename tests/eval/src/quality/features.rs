//! The four curves that describe a mouth: opening, width, jaw and rounding.

use ndarray::Array2;

use anyface::Result;

use crate::metrics::{self, mouth_width};

const MM: f64 = 1000.0;
const CHIN: usize = 8;
/// Middles of the outer lips, which move forward when the lips are rounded.
const MIDDLES: [usize; 2] = [51, 57];
/// Number of features.
pub(super) const COUNT: usize = 4;
/// Indices of the features in the result of [`of`].
pub(super) const GAP: usize = 0;
pub(super) const WIDTH: usize = 1;
pub(super) const CHIN_DROP: usize = 2;
pub(super) const PROTRUSION: usize = 3;

/// Every feature of motion `[T, 68, 3]` on a face `[68, 3]`, both in metres: `[4][T]` millimetres.
///
/// The features are the inner-lip gap ‖62 − 66‖, the mouth width ‖48 − 54‖, the drop of the chin
/// (−y of 8) and the protrusion (mean z of 51 and 57). The last two are relative to rest.
pub(super) fn of(face: &Array2<f64>, motion: metrics::Clip<'_>) -> Result<[Vec<f64>; COUNT]> {
    let positions = (&motion + face) * MM;
    let forward = |t: usize| 0.5 * MIDDLES.map(|n| motion[[t, n, 2]]).iter().sum::<f64>();
    let frames = || 0..motion.dim().0;
    Ok([
        metrics::lip_gap(positions.view())?,
        mouth_width(positions.view())?,
        frames().map(|t| -MM * motion[[t, CHIN, 1]]).collect(),
        frames().map(|t| MM * forward(t)).collect(),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::mesh::ibug::LANDMARKS;
    use ndarray::Array3;

    #[test]
    fn each_feature_follows_its_own_landmarks() {
        let mut neutral = Array2::zeros((LANDMARKS, 3));
        (neutral[[48, 0]], neutral[[54, 0]]) = (0.025, -0.025);
        let mut motion = Array3::zeros((2, LANDMARKS, 3));
        motion[[1, 66, 1]] = -0.010;
        motion[[1, 48, 0]] = 0.001;
        motion[[1, 8, 1]] = -0.008;
        motion[[1, 51, 2]] = 0.004;
        motion[[1, 57, 2]] = 0.002;
        let result = of(&neutral, motion.view()).unwrap();
        let expected = [[0.0, 10.0], [50.0, 51.0], [0.0, 8.0], [0.0, 3.0]];
        for (result, expected) in result.iter().zip(expected) {
            assert!(
                result
                    .iter()
                    .zip(expected)
                    .all(|(a, b)| (a - b).abs() < 1e-9)
            );
        }
    }
}
