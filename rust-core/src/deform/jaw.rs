//! The motion of the lower jaw that the chin's landmarks imply.
//!
//! The jaw turns about an axis across the head and slides forward and sideways; those three
//! numbers are the least-squares fit to the five landmarks of the chin, so they are linear in the
//! landmarks, and so is what the teeth do.

use faer::{Mat, linalg::solvers::Solve};
use ndarray::Array2;

use crate::motion::LANDMARKS;

/// Numbers that describe the jaw: angle, sideways, forward.
pub const JAW_RANK: usize = 3;

/// A point of the axis, canonical centimetres: where ICT FaceKit's lower teeth turn.
const HINGE_CM: [f64; 3] = [0.0, -3.13, -1.97];
/// Landmarks of the chin.
const CHIN: std::ops::RangeInclusive<usize> = 6..=10;
/// The chin's skin moves less than the bone beneath it; measured on ICT FaceKit.
const BONE_GAIN: f64 = 1.2;

/// Displacement of a point for each number, `[axis][number]`.
fn pattern(point: [f64; 3]) -> [[f64; JAW_RANK]; 3] {
    let (y, z) = (point[1] - HINGE_CM[1], point[2] - HINGE_CM[2]);
    [[0.0, 1.0, 0.0], [-z, 0.0, 0.0], [y, 0.0, 1.0]]
}

/// `[3 numbers, 204]`: the jaw's numbers from landmark displacements. `landmarks`: of the neutral
/// face, canonical centimetres; displacements in any unit, the same as [`follow`]'s result.
pub fn from_landmarks(landmarks: &[[f32; 3]; LANDMARKS]) -> Array2<f32> {
    let count = CHIN.count();
    let mut patterns = Mat::<f64>::zeros(3 * count, JAW_RANK);
    for (i, n) in CHIN.enumerate() {
        for (axis, row) in pattern(landmarks[n].map(f64::from)).iter().enumerate() {
            for (k, &value) in row.iter().enumerate() {
                patterns[(3 * i + axis, k)] = value;
            }
        }
    }
    let mut normal = patterns.transpose() * &patterns;
    for k in 0..JAW_RANK {
        // Keeps the fit defined where the landmarks of the chin fall together.
        normal[(k, k)] += 1e-6;
    }
    let fit = normal.partial_piv_lu().solve(patterns.transpose());
    let mut out = Array2::zeros((JAW_RANK, 3 * LANDMARKS));
    for k in 0..JAW_RANK {
        for c in 0..3 * count {
            out[[k, 3 * CHIN.start() + c]] = (BONE_GAIN * fit[(k, c)]) as f32;
        }
    }
    out
}

/// Displacement `[axis][number]` of a point that follows the jaw by `share`. `point`: canonical
/// centimetres.
pub fn follow(point: [f32; 3], share: f32) -> [[f32; JAW_RANK]; 3] {
    pattern(point.map(f64::from)).map(|row| row.map(|x| share * x as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    #[test]
    fn a_turning_jaw_is_recovered_from_the_chin() {
        let landmarks = canonical_landmarks().map(|p| p.map(|x| 100.0 * x));
        let numbers = [0.1f32, 0.2, -0.3];
        let fit = from_landmarks(&landmarks);
        let moved: Vec<f32> = landmarks
            .iter()
            .flat_map(|&p| follow(p, 1.0))
            .map(|row| (0..3).map(|k| row[k] * numbers[k]).sum())
            .collect();
        for (k, expected) in numbers.iter().enumerate() {
            let got: f32 = fit.row(k).iter().zip(&moved).map(|(a, b)| a * b).sum();
            assert!((got - BONE_GAIN as f32 * expected).abs() < 1e-4);
        }
    }
}
