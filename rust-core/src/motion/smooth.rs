//! Smooths motion over time.

use ndarray::{Array, Axis, Dimension, RemoveAxis};

use super::{LandmarkClip, WeightClip};

/// The Gaussian is cut off where it has fallen to e^(−9/2).
const REACH_IN_DEVIATIONS: f64 = 3.0;

impl LandmarkClip {
    /// Gaussian smoothing over time with a standard deviation of `deviation_s` seconds. The first
    /// and last frame are held beyond the ends.
    ///
    /// 0 changes nothing. 20 ms softens jitter. Beyond 50 ms the lips no longer close.
    pub fn smoothed(&self, deviation_s: f64) -> LandmarkClip {
        LandmarkClip {
            displacements: smoothed(&self.displacements, deviation_s * self.fps),
            fps: self.fps,
        }
    }
}

impl WeightClip {
    /// As [`LandmarkClip::smoothed`].
    pub fn smoothed(&self, deviation_s: f64) -> WeightClip {
        WeightClip {
            names: self.names.clone(),
            weights: smoothed(&self.weights, deviation_s * self.fps),
            fps: self.fps,
            together: self.together.clone(),
        }
    }
}

/// Gaussian smoothing along the first axis. `deviation` is the standard deviation in frames.
pub(crate) fn smoothed<D: Dimension + RemoveAxis>(
    values: &Array<f32, D>,
    deviation: f64,
) -> Array<f32, D> {
    if deviation.is_nan() || deviation <= 0.0 || values.is_empty() {
        return values.clone();
    }
    let reach = (REACH_IN_DEVIATIONS * deviation).ceil() as isize;
    let weight = |k: isize| (-0.5 * (k as f64 / deviation).powi(2)).exp();
    let total: f64 = (-reach..=reach).map(weight).sum();
    let last = values.len_of(Axis(0)) as isize - 1;
    let mut out = Array::zeros(values.raw_dim());
    for (t, mut frame) in out.axis_iter_mut(Axis(0)).enumerate() {
        for k in -reach..=reach {
            let from = (t as isize + k).clamp(0, last) as usize;
            let share = (weight(k) / total) as f32;
            frame.scaled_add(share, &values.index_axis(Axis(0), from));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn clip(value: impl Fn(usize) -> f32) -> LandmarkClip {
        LandmarkClip {
            displacements: Array3::from_shape_fn((30, 68, 3), |(t, _, _)| value(t)),
            fps: 30.0,
        }
    }

    #[test]
    fn constants_and_lines_stay_and_jitter_goes() {
        let constant = clip(|_| 0.7).smoothed(0.05);
        assert!(
            constant
                .displacements
                .iter()
                .all(|x| (x - 0.7).abs() < 1e-6)
        );
        let line = clip(|t| t as f32).smoothed(0.05);
        assert!((line.displacements[[15, 0, 0]] - 15.0).abs() < 1e-4);
        let jitter = clip(|t| if t % 2 == 0 { 1.0 } else { -1.0 }).smoothed(0.05);
        assert!(jitter.displacements[[15, 0, 0]].abs() < 1e-3);
    }

    #[test]
    fn no_deviation_changes_nothing() {
        let motion = clip(|t| (t as f32).sin());
        assert_eq!(motion.smoothed(0.0), motion);
        assert_eq!(motion.smoothed(f64::NAN), motion);
    }
}
