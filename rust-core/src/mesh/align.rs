//! The similarity from a user's mesh to the canonical face frame.
//!
//! [`Similarity::fit`] is the weighted least-squares fit of Horn 1987 ("Closed-form solution of
//! absolute orientation using unit quaternions"): the best rotation is the leading eigenvector of
//! a symmetric 4×4 matrix. Umeyama 1991 has the same optimum, but Horn's form never returns a
//! reflection. Its smallest eigenvalue says how well a reflection would have fitted, which reveals
//! mirrored meshes.

use ndarray::{Array3, ArrayView3};
use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// `y = scale · rotation · x + translation`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    /// Uniform, positive.
    pub scale: f64,
    /// Row-major rotation, determinant +1.
    pub rotation: [[f64; 3]; 3],
    /// In the target's units.
    pub translation: [f64; 3],
}

/// A fitted similarity and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The best similarity with a proper rotation.
    pub similarity: Similarity,
    /// Weighted root mean square of the remaining distances, target units.
    pub rms: f64,
    /// The same for the best reflection instead of a rotation. Below `rms` for a mirrored set.
    pub mirrored_rms: f64,
}

impl Similarity {
    /// Leaves every point where it is.
    pub const IDENTITY: Similarity = Similarity {
        scale: 1.0,
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
    };

    /// The similarity that brings `from` closest to `to` in weighted least squares.
    ///
    /// `from`, `to`: `[N]` points. `weights`: `[N]`, not negative; `None` gives all points the same
    /// weight. Horn 1987, eq. 33–35. The scale minimises the distances in the target.
    ///
    /// # Errors
    /// `ShapeMismatch` for unequal lengths, `InvalidInput` for non-finite points, fewer than three
    /// weighted points, or points that coincide.
    pub fn fit(from: &[[f32; 3]], to: &[[f32; 3]], weights: Option<&[f64]>) -> Result<Fit> {
        check_lengths(from, to, weights)?;
        let ones = vec![1.0; from.len()];
        let weights = weights.unwrap_or(&ones);
        let total: f64 = weights.iter().sum();
        let (mean_from, mean_to) = (mean(from, weights), mean(to, weights));
        let (covariance, spread_from, spread_to) = moments(from, to, weights, mean_from, mean_to);
        if !(spread_from.is_finite() && spread_to.is_finite()) {
            return Err(Error::InvalidInput("points to align: not finite".into()));
        }
        if weights.iter().filter(|w| **w > 0.0).count() < 3
            || spread_from <= 1e-24
            || spread_to <= 1e-24
        {
            let message = "points to align: expected at least three different points";
            return Err(Error::InvalidInput(message.into()));
        }
        let (values, vectors) = symmetric_eigen(horn_matrix(&covariance));
        let (best, worst) = extremes(&values);
        let rotation = rotation_of(std::array::from_fn(|i| vectors[i][best]));
        let scale = values[best] / spread_from;
        let similarity = Similarity::about(scale, rotation, mean_from, mean_to);
        let rms = |trace: f64| ((spread_to - trace * trace / spread_from).max(0.0) / total).sqrt();
        Ok(Fit {
            similarity,
            rms: rms(values[best]),
            mirrored_rms: rms(-values[worst]),
        })
    }

    /// The similarity with this scale and rotation that takes `from` to `to`.
    fn about(scale: f64, rotation: [[f64; 3]; 3], from: [f64; 3], to: [f64; 3]) -> Self {
        let turned = turn(&rotation, from);
        Similarity {
            scale,
            rotation,
            translation: std::array::from_fn(|i| to[i] - scale * turned[i]),
        }
    }

    /// Moves a point from the mesh's frame to the target frame.
    pub fn apply(&self, point: [f32; 3]) -> [f32; 3] {
        let turned = turn(&self.rotation, point.map(f64::from));
        std::array::from_fn(|i| (self.scale * turned[i] + self.translation[i]) as f32)
    }

    /// Rotates a direction into the target frame and keeps its length.
    pub fn rotate(&self, direction: [f32; 3]) -> [f32; 3] {
        turn(&self.rotation, direction.map(f64::from)).map(|x| x as f32)
    }

    /// The inverse map: `inverse().apply(apply(p))` is `p`.
    pub fn inverse(&self) -> Similarity {
        let rotation = std::array::from_fn(|i| std::array::from_fn(|j| self.rotation[j][i]));
        let turned = turn(&rotation, self.translation);
        Similarity {
            scale: 1.0 / self.scale,
            rotation,
            translation: turned.map(|x| -x / self.scale),
        }
    }

    /// The similarity that applies `first`, then `self`.
    pub fn compose(&self, first: &Similarity) -> Similarity {
        let turned = turn(&self.rotation, first.translation);
        Similarity {
            scale: self.scale * first.scale,
            rotation: std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    (0..3)
                        .map(|k| self.rotation[i][k] * first.rotation[k][j])
                        .sum()
                })
            }),
            translation: std::array::from_fn(|i| self.scale * turned[i] + self.translation[i]),
        }
    }

    /// Converts displacements from the mesh's own units and axes to the target frame.
    ///
    /// `displacements`: `[T, N, 3]`, mesh units. Returns `[T, N, 3]`, target units.
    pub fn displacements_to_canonical(&self, displacements: ArrayView3<'_, f32>) -> Array3<f32> {
        let mut out = Array3::zeros(displacements.dim());
        for (from, mut to) in displacements.rows().into_iter().zip(out.rows_mut()) {
            for i in 0..3 {
                let turned: f64 = (0..3)
                    .map(|j| self.rotation[i][j] * f64::from(from[j]))
                    .sum();
                to[i] = (turned * self.scale) as f32;
            }
        }
        out
    }

    /// Converts displacements from the target frame back to the mesh's own units and axes.
    ///
    /// `displacements`: `[T, N, 3]`, target units. Returns `[T, N, 3]`, mesh units.
    pub fn displacements_to_mesh(&self, displacements: ArrayView3<'_, f32>) -> Array3<f32> {
        let mut out = Array3::zeros(displacements.dim());
        for (from, mut to) in displacements.rows().into_iter().zip(out.rows_mut()) {
            for i in 0..3 {
                let turned: f64 = (0..3)
                    .map(|j| self.rotation[j][i] * f64::from(from[j]))
                    .sum();
                to[i] = (turned / self.scale) as f32;
            }
        }
        out
    }
}

fn check_lengths(from: &[[f32; 3]], to: &[[f32; 3]], weights: Option<&[f64]>) -> Result<()> {
    let weights_len = weights.map_or(from.len(), <[f64]>::len);
    if from.len() == to.len() && from.len() == weights_len {
        return Ok(());
    }
    Err(Error::ShapeMismatch {
        what: "points to align",
        expected: format!("[{}, 3] with as many weights", from.len()),
        got: format!("[{}, 3] with {weights_len} weights", to.len()),
    })
}

fn turn(rotation: &[[f64; 3]; 3], p: [f64; 3]) -> [f64; 3] {
    rotation.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2])
}

fn mean(points: &[[f32; 3]], weights: &[f64]) -> [f64; 3] {
    let total: f64 = weights.iter().sum();
    std::array::from_fn(|i| {
        let sum: f64 = points
            .iter()
            .zip(weights)
            .map(|(p, w)| w * f64::from(p[i]))
            .sum();
        sum / total
    })
}

/// `Σ w a bᵀ` of the centred points, `Σ w |a|²` and `Σ w |b|²`.
fn moments(
    from: &[[f32; 3]],
    to: &[[f32; 3]],
    weights: &[f64],
    mean_from: [f64; 3],
    mean_to: [f64; 3],
) -> ([[f64; 3]; 3], f64, f64) {
    let mut covariance = [[0.0; 3]; 3];
    let (mut spread_from, mut spread_to) = (0.0, 0.0);
    for ((p, q), &w) in from.iter().zip(to).zip(weights) {
        let a: [f64; 3] = std::array::from_fn(|i| f64::from(p[i]) - mean_from[i]);
        let b: [f64; 3] = std::array::from_fn(|i| f64::from(q[i]) - mean_to[i]);
        for i in 0..3 {
            spread_from += w * a[i] * a[i];
            spread_to += w * b[i] * b[i];
            for j in 0..3 {
                covariance[i][j] += w * a[i] * b[j];
            }
        }
    }
    (covariance, spread_from, spread_to)
}

/// Horn 1987, the matrix N: its eigenvalue for quaternion q is the trace `Σ w b · R(q) a`.
fn horn_matrix(s: &[[f64; 3]; 3]) -> [[f64; 4]; 4] {
    let (x, y, z) = (s[1][2] - s[2][1], s[2][0] - s[0][2], s[0][1] - s[1][0]);
    let (xy, xz, yz) = (s[0][1] + s[1][0], s[0][2] + s[2][0], s[1][2] + s[2][1]);
    [
        [s[0][0] + s[1][1] + s[2][2], x, y, z],
        [x, s[0][0] - s[1][1] - s[2][2], xy, xz],
        [y, xy, s[1][1] - s[0][0] - s[2][2], yz],
        [z, xz, yz, s[2][2] - s[0][0] - s[1][1]],
    ]
}

/// Row-major rotation of the unit quaternion (w, x, y, z).
fn rotation_of([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [
            w * w + x * x - y * y - z * z,
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            w * w - x * x + y * y - z * z,
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            w * w - x * x - y * y + z * z,
        ],
    ]
}

/// Indices of the largest and the smallest value.
fn extremes(values: &[f64; 4]) -> (usize, usize) {
    let order = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
    let best = (0..4).max_by(order).unwrap_or(0);
    let worst = (0..4).min_by(order).unwrap_or(0);
    (best, worst)
}

/// Eigenvalues and eigenvectors (columns) of a symmetric 4×4 matrix by cyclic Jacobi rotations
/// (Golub & Van Loan, §8.5). A dozen sweeps are far more than a 4×4 matrix needs.
fn symmetric_eigen(mut a: [[f64; 4]; 4]) -> ([f64; 4], [[f64; 4]; 4]) {
    let mut v: [[f64; 4]; 4] =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for _ in 0..12 {
        for p in 0..3 {
            for q in p + 1..4 {
                jacobi_rotate(&mut a, &mut v, p, q);
            }
        }
    }
    (std::array::from_fn(|i| a[i][i]), v)
}

fn jacobi_rotate(a: &mut [[f64; 4]; 4], v: &mut [[f64; 4]; 4], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..4 {
        (a[k][p], a[k][q]) = (c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]);
    }
    for k in 0..4 {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
        (v[k][p], v[k][q]) = (c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud() -> Vec<[f32; 3]> {
        (0..20)
            .map(|i| {
                let t = i as f32;
                [
                    (t * 1.3).sin(),
                    (t * 0.7).cos() * 1.4,
                    (t * 2.1).sin() * 0.6,
                ]
            })
            .collect()
    }

    fn similarity(q: [f64; 4], scale: f64, translation: [f64; 3]) -> Similarity {
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        Similarity {
            scale,
            rotation: rotation_of(q.map(|x| x / norm)),
            translation,
        }
    }

    proptest! {
        #[test]
        fn fit_recovers_any_similarity(
            q in prop::array::uniform4(-1.0f64..1.0),
            log_scale in -4.0f64..4.0,
            t in prop::array::uniform3(-3.0f64..3.0),
        ) {
            prop_assume!(q.iter().map(|x| x * x).sum::<f64>() > 0.01);
            let scale = log_scale.exp();
            let truth = similarity(q, scale, t.map(|x| x * scale));
            let from = cloud();
            let to: Vec<_> = from.iter().map(|p| truth.apply(*p)).collect();
            let fit = Similarity::fit(&from, &to, None).unwrap();
            prop_assert!((fit.similarity.scale / scale - 1.0).abs() < 1e-5);
            prop_assert!(fit.rms < 1e-5 * scale && fit.mirrored_rms > 0.05 * scale);
            let back = fit.similarity.inverse().compose(&fit.similarity);
            for p in &from {
                let there = fit.similarity.inverse().apply(fit.similarity.apply(*p));
                let same = back.apply(*p);
                for i in 0..3 {
                    prop_assert!((there[i] - p[i]).abs() < 1e-4);
                    prop_assert!((same[i] - p[i]).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn a_reflected_set_fits_better_mirrored_and_keeps_a_proper_rotation() {
        let from = cloud();
        let to: Vec<_> = from.iter().map(|p| [-p[0], p[1], p[2]]).collect();
        let fit = Similarity::fit(&from, &to, None).unwrap();
        assert!(fit.mirrored_rms < 1e-5 && fit.rms > 0.1);
        let r = fit.similarity.rotation;
        let det = r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1])
            - r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0])
            + r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0]);
        assert!((det - 1.0).abs() < 1e-9);
    }

    #[test]
    fn points_without_weight_do_not_count() {
        let from = cloud();
        let mut to = from.clone();
        to[3] = [50.0, 0.0, 0.0];
        let mut weights = vec![1.0; from.len()];
        weights[3] = 0.0;
        let fit = Similarity::fit(&from, &to, Some(&weights)).unwrap();
        assert!(fit.rms < 1e-6);
    }

    #[test]
    fn unfit_points_are_refused() {
        let from = cloud();
        let short = Similarity::fit(&from, &from[1..], None);
        assert!(matches!(short, Err(Error::ShapeMismatch { .. })));
        let same = vec![[1.0; 3]; 20];
        assert!(Similarity::fit(&same, &from, None).is_err());
        let mut broken = from.clone();
        broken[0][0] = f32::NAN;
        assert!(Similarity::fit(&broken, &from, None).is_err());
    }

    #[test]
    fn displacements_return_to_mesh_units() {
        let s = similarity([0.9, 0.1, -0.4, 0.2], 0.01, [1.0, 2.0, 3.0]);
        let (p, d) = ([1.0, -2.0, 0.5], [0.3, 0.2, -0.7]);
        let moved = s.apply(std::array::from_fn(|i| p[i] + d[i]));
        let still = s.apply(p);
        let target = Array3::from_shape_fn((1, 1, 3), |(_, _, i)| moved[i] - still[i]);
        let back = s.displacements_to_mesh(target.view());
        for i in 0..3 {
            assert!((back[[0, 0, i]] - d[i]).abs() < 1e-4);
        }
    }
}
