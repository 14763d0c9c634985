//! A Gaussian over the shapes that the 68 landmarks of a face form, in the canonical frame.
//!
//! Its covariance is that of human, warped and stylised faces (the leading modes, written by
//! `python -m training.landmarks.prior`) plus a short-range part, which lets neighbours move
//! together where no mode does. The Gaussian is conditioned on the measured landmarks, each with
//! its own noise (Bishop 2006, eq. 2.113–2.117). Sure landmarks stay, unsure ones move to where the
//! others suggest, fixed ones are exact.

use faer::{
    Mat, Side,
    linalg::solvers::{DenseSolveCore, Solve},
};

use crate::{
    Error, Result,
    mesh::{canonical_landmarks, ibug::LANDMARKS},
    models::Weights,
};

/// Standard deviation of the covariance's short-range part, metres.
const LOCAL_M: f64 = 0.0022;
/// Distance over which the short-range part couples neighbours (a Gaussian's deviation), metres.
const LOCAL_REACH_M: f64 = 0.011;

/// Standard deviation of a landmark with confidence one, metres.
const SURE_M: f64 = 0.0012;

/// A landmark this far from where the others expect it is half as sure, metres.
const ODD_M: f64 = 0.010;

/// Standard deviation of a landmark that the caller fixed, metres.
const FIXED_M: f64 = 1e-6;

const COORDINATES: usize = 3 * LANDMARKS;

/// One landmark as measured, in the canonical frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// Metres.
    pub position: [f32; 3],
    /// 0 to 1.
    pub confidence: f32,
    /// Whether the caller fixed it.
    pub fixed: bool,
}

/// The Gaussian over landmark shapes.
pub(super) struct ShapePrior {
    /// `[204, 204]`, metres².
    covariance: Mat<f64>,
}

impl ShapePrior {
    /// Reads `modes` `[count, 204]`, metres. The length of each mode is its standard deviation.
    ///
    /// # Errors
    /// `Weights` if they are missing or have another shape.
    pub fn load(weights: &Weights, count: usize) -> Result<Self> {
        let modes = weights.values("modes", &[count, COORDINATES])?;
        let mean = canonical_landmarks();
        let local = |i: usize, j: usize| {
            let d2: f32 = (0..3).map(|k| (mean[i][k] - mean[j][k]).powi(2)).sum();
            LOCAL_M.powi(2) * (-0.5 * f64::from(d2) / LOCAL_REACH_M.powi(2)).exp()
        };
        let covariance = Mat::from_fn(COORDINATES, COORDINATES, |i, j| {
            let shared: f64 = modes
                .chunks_exact(COORDINATES)
                .map(|mode| f64::from(mode[i]) * f64::from(mode[j]))
                .sum();
            if i % 3 == j % 3 {
                shared + local(i / 3, j / 3)
            } else {
                shared
            }
        });
        Ok(ShapePrior { covariance })
    }

    /// The likeliest landmarks given all measured ones, and a new confidence for each: the measured
    /// one times a factor from 0 to 1 that says how well it agrees with the others (1 if fixed).
    /// Solves again twice with more noise on outliers, so that they lose influence.
    ///
    /// # Errors
    /// `Numerics` if the measured places are not finite.
    pub fn refine(
        &self,
        measured: &[Measured; LANDMARKS],
    ) -> Result<([[f32; 3]; LANDMARKS], [f32; LANDMARKS])> {
        let mut deviation: Vec<f64> = measured.iter().map(deviation).collect();
        let mut solved = self.condition(measured, &deviation)?;
        for _ in 0..2 {
            for (i, m) in measured.iter().enumerate().filter(|(_, m)| !m.fixed) {
                let odd = (solved.surprise[i] / ODD_M).powi(2);
                deviation[i] = self::deviation(m) * (1.0 + odd);
            }
            solved = self.condition(measured, &deviation)?;
        }
        let confidence = std::array::from_fn(|i| {
            let odd = (solved.surprise[i] / ODD_M).powi(2);
            if measured[i].fixed {
                1.0
            } else {
                measured[i].confidence / (1.0 + odd) as f32
            }
        });
        Ok((solved.positions, confidence))
    }

    /// Posterior mean, and each landmark's distance from where the others expect it (leave-one-out:
    /// the residual `[A⁻¹]ᵢᵢ⁻¹ [A⁻¹(y − m)]ᵢ` for `A` = covariance + noise).
    fn condition(&self, measured: &[Measured; LANDMARKS], deviation: &[f64]) -> Result<Solved> {
        let mean = canonical_landmarks();
        let mut noisy = self.covariance.clone();
        for i in 0..COORDINATES {
            noisy[(i, i)] += deviation[i / 3].powi(2);
        }
        let off = Mat::from_fn(COORDINATES, 1, |i, _| {
            f64::from(measured[i / 3].position[i % 3] - mean[i / 3][i % 3])
        });
        let factors = noisy
            .llt(Side::Lower)
            .map_err(|e| Error::Numerics(format!("the shape of the landmarks: {e:?}")))?;
        let pull = factors.solve(&off);
        let inverse = factors.inverse();
        let moved = &self.covariance * &pull;
        Ok(Solved {
            positions: std::array::from_fn(|i| {
                std::array::from_fn(|k| mean[i][k] + moved[(3 * i + k, 0)] as f32)
            }),
            surprise: std::array::from_fn(|i| {
                let part = |k: usize| pull[(3 * i + k, 0)] / inverse[(3 * i + k, 3 * i + k)];
                (0..3).map(|k| part(k).powi(2)).sum::<f64>().sqrt()
            }),
        })
    }
}

struct Solved {
    positions: [[f32; 3]; LANDMARKS],
    surprise: [f64; LANDMARKS],
}

fn deviation(measured: &Measured) -> f64 {
    if measured.fixed {
        FIXED_M
    } else {
        SURE_M / f64::from(measured.confidence.max(0.02))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use glam::Vec3;

    use super::*;

    /// The embedded prior.
    pub fn embedded() -> ShapePrior {
        let files = super::super::MODEL.open(None).unwrap();
        let weights = Weights::from_bytes(&files.weights).unwrap();
        let config = super::super::Config::parse(&files.config).unwrap();
        ShapePrior::load(&weights.pp("prior"), config.prior_modes).unwrap()
    }

    fn mean_face() -> [Measured; LANDMARKS] {
        canonical_landmarks().map(|position| Measured {
            position,
            confidence: 0.9,
            fixed: false,
        })
    }

    #[test]
    fn the_mean_face_stays_where_it_is_and_stays_sure() {
        let (positions, confidence) = embedded().refine(&mean_face()).unwrap();
        for (p, q) in positions.iter().zip(canonical_landmarks()) {
            assert!(Vec3::from(*p).distance((*q).into()) < 1e-6);
        }
        assert!(confidence.iter().all(|c| (c - 0.9).abs() < 1e-3));
    }

    #[test]
    fn a_landmark_out_of_place_is_pulled_back_and_loses_its_confidence() {
        let mut measured = mean_face();
        measured[37].position[1] += 0.04;
        let (positions, confidence) = embedded().refine(&measured).unwrap();
        assert!(Vec3::from(positions[37]).distance(canonical_landmarks()[37].into()) < 0.006);
        assert!(
            confidence[37] < 0.3 && confidence[62] > 0.8,
            "{confidence:?}"
        );
    }

    #[test]
    fn fixed_landmarks_are_exact_and_their_neighbours_follow() {
        let mut measured = mean_face().map(|m| Measured {
            confidence: 0.1,
            ..m
        });
        for i in 48..51 {
            measured[i].position[1] -= 0.008;
            measured[i].fixed = true;
        }
        let (positions, confidence) = embedded().refine(&measured).unwrap();
        let mean = canonical_landmarks();
        for i in 48..51 {
            assert!(Vec3::from(positions[i]).distance(measured[i].position.into()) < 1e-5);
            assert!(confidence[i] == 1.0);
        }
        let down = |i: usize| mean[i][1] - positions[i][1];
        assert!(
            down(60) > 0.004 && down(59) > 0.003,
            "{} {}",
            down(60),
            down(59)
        );
        assert!(down(21).abs() < 0.5 * down(60));
    }
}
