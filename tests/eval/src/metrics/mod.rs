//! How far an animation is from the truth: one file per metric, named as in its paper.
//!
//! Metrics see arrays and units, never a model. All take clips `[T, V, 3]` in the caller's unit;
//! displacements and positions give the same numbers, because the neutral face cancels. They work
//! in double precision and match public implementations on reference arrays.

mod closure;
mod control_rate;
mod correlation;
mod delta_cd;
mod eyeballs_in_sight;
mod fdd;
mod lag;
mod lip_gap;
mod lve;
mod moments;
mod mouth_width;
mod mve;
mod quantile;
mod seed_deviation;
mod spectrum;
mod speed;

pub use closure::{Closure, closures};
pub use control_rate::{control_leak, control_rate};
pub use correlation::pearson;
pub use delta_cd::delta_cd;
pub use eyeballs_in_sight::eyeballs_in_sight;
pub use fdd::face_dynamics_deviation;
pub use lag::LagCurve;
pub use lip_gap::lip_gap;
pub use lve::lip_vertex_error;
pub use moments::Moments;
pub use mouth_width::mouth_width;
pub use mve::mean_vertex_error;
pub use quantile::quantile;
pub use seed_deviation::seed_deviation;
pub use spectrum::Spectrum;
pub use speed::{rms_accelerations, rms_speeds, root_mean_square};

use ndarray::ArrayView3;

use anyface::{Error, Result};

/// A clip of vertices or landmarks, `[T, V, 3]`.
pub type Clip<'a> = ArrayView3<'a, f64>;

/// Checks that both clips have the same shape and at least `frames` frames, and contain every
/// vertex of `region`.
fn check(prediction: Clip<'_>, truth: Clip<'_>, region: &[usize], frames: usize) -> Result<()> {
    let (count, vertices, axes) = truth.dim();
    if prediction.dim() != truth.dim() || axes != 3 || count < frames {
        return Err(Error::ShapeMismatch {
            what: "prediction",
            expected: format!("[T ≥ {frames}, V, 3] as the truth's {:?}", truth.shape()),
            got: format!("{:?}", prediction.shape()),
        });
    }
    match region.iter().find(|v| **v >= vertices) {
        Some(v) => Err(Error::InvalidInput(format!(
            "region: expected vertices below {vertices}, got {v}"
        ))),
        None => Ok(()),
    }
}

/// Squared distance between vertex `v` of clip `a` and that of clip `b` in frame `t`.
fn squared_distance(a: Clip<'_>, b: Clip<'_>, t: usize, v: usize) -> f64 {
    (0..3).map(|i| (a[[t, v, i]] - b[[t, v, i]]).powi(2)).sum()
}

#[cfg(test)]
mod tests;
