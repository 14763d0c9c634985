//! Fits a sphere to points by algebraic least squares.

use faer::{Mat, linalg::solvers::Solve};
use glam::Vec3;

/// Centre and radius of the sphere that fits points best, and the root mean square of their
/// distances from it; `None` for fewer than eight points, or for points in one plane.
pub(crate) fn fit_sphere(
    points: impl Iterator<Item = [f32; 3]> + Clone,
) -> Option<([f32; 3], f32, f32)> {
    let count = points.clone().count();
    if count < 8 {
        return None;
    }
    let mut mean = [0.0f64; 3];
    for p in points.clone() {
        (0..3).for_each(|i| mean[i] += f64::from(p[i]) / count as f64);
    }
    // |p|² = 2 c·p + (r² − |c|²), relative to the mean so that the system is well scaled.
    let (mut normal, mut right) = (Mat::<f64>::zeros(4, 4), Mat::<f64>::zeros(4, 1));
    for p in points.clone() {
        let q: [f64; 3] = std::array::from_fn(|i| f64::from(p[i]) - mean[i]);
        let row = [2.0 * q[0], 2.0 * q[1], 2.0 * q[2], 1.0];
        let value: f64 = q.iter().map(|x| x * x).sum();
        for i in 0..4 {
            right[(i, 0)] += row[i] * value;
            (0..4).for_each(|j| normal[(i, j)] += row[i] * row[j]);
        }
    }
    let x = normal.partial_piv_lu().solve(&right);
    let offset = [x[(0, 0)], x[(1, 0)], x[(2, 0)]];
    let radius = (x[(3, 0)] + offset.iter().map(|x| x * x).sum::<f64>()).sqrt() as f32;
    let centre: [f32; 3] = std::array::from_fn(|i| (mean[i] + offset[i]) as f32);
    let off: f32 = points
        .map(|p| (Vec3::from(p).distance(centre.into()) - radius).powi(2))
        .sum();
    let off = (off / count as f32).sqrt();
    (radius.is_finite() && off.is_finite()).then_some((centre, radius, off))
}
