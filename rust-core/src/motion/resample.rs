//! Resamples motion to another frame rate.

use ndarray::{Array, ArrayView, Axis, Dimension, RemoveAxis, Zip};

use super::{LandmarkClip, WeightClip};

impl LandmarkClip {
    /// The same motion as `frames` frames at `fps`. Frame `t` is at `t / fps` seconds.
    ///
    /// Interpolates between the four nearest frames (Catmull-Rom), so that the velocity has no
    /// steps. The last frame is held beyond the end. Between frames the curve may overshoot by an
    /// eighth of a step, which preserves peaks.
    pub fn at_rate(&self, fps: f64, frames: usize) -> LandmarkClip {
        let displacements = at_rate(self.displacements.view(), self.fps / fps, frames);
        LandmarkClip { displacements, fps }
    }
}

impl WeightClip {
    /// As [`LandmarkClip::at_rate`], with no weight below 0. `together` is left empty and has to be
    /// computed again.
    pub fn at_rate(&self, fps: f64, frames: usize) -> WeightClip {
        let mut weights = at_rate(self.weights.view(), self.fps / fps, frames);
        weights.mapv_inplace(|weight| weight.max(0.0));
        let names = self.names.clone();
        WeightClip {
            names,
            weights,
            fps,
            together: Vec::new(),
        }
    }
}

/// Samples `frames` frames that are `step` frames of `values` apart.
pub(crate) fn at_rate<D: Dimension + RemoveAxis>(
    values: ArrayView<'_, f32, D>,
    step: f64,
    frames: usize,
) -> Array<f32, D> {
    let mut shape = values.raw_dim();
    shape[0] = frames;
    let mut out = Array::zeros(shape);
    let Some(last) = values.len_of(Axis(0)).checked_sub(1) else {
        return out;
    };
    for (t, mut frame) in out.axis_iter_mut(Axis(0)).enumerate() {
        let position = (t as f64 * step).min(last as f64);
        let before = position.floor() as usize;
        let weights = catmull_rom((position - before as f64) as f32);
        let source = |offset: usize| (before + offset).saturating_sub(1).min(last);
        for (offset, weight) in weights.into_iter().enumerate() {
            let from = values.index_axis(Axis(0), source(offset));
            Zip::from(&mut frame)
                .and(from)
                .for_each(|to, from| *to += weight * from);
        }
    }
    out
}

/// Weights of the frames at −1, 0, 1 and 2 for a point at `u`, between frames 0 and 1.
fn catmull_rom(u: f32) -> [f32; 4] {
    let (u2, u3) = (u * u, u * u * u);
    [
        0.5 * (2.0 * u2 - u3 - u),
        0.5 * (3.0 * u3 - 5.0 * u2 + 2.0),
        0.5 * (4.0 * u2 - 3.0 * u3 + u),
        0.5 * (u3 - u2),
    ]
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn clip(fps: f64, values: impl Fn(f64) -> f32, frames: usize) -> LandmarkClip {
        LandmarkClip {
            displacements: Array3::from_shape_fn((frames, 68, 3), |(t, _, _)| {
                values(t as f64 / fps)
            }),
            fps,
        }
    }

    #[test]
    fn same_rate_changes_nothing() {
        let motion = clip(25.0, |s| (9.0 * s).sin() as f32, 40);
        assert_eq!(motion.at_rate(25.0, 40), motion);
    }

    #[test]
    fn lines_stay_lines_inside_the_clip() {
        let motion = clip(25.0, |s| 3.0 * s as f32, 26).at_rate(30.0, 28);
        for t in 2..28 {
            let expected = 3.0 * t as f32 / 30.0;
            assert!(
                (motion.displacements[[t, 5, 1]] - expected).abs() < 1e-5,
                "frame {t}"
            );
        }
    }

    #[test]
    fn speech_rates_survive_25_to_30() {
        let wave = |s: f64| (2.0 * std::f64::consts::PI * 4.0 * s).sin() as f32;
        let motion = clip(25.0, wave, 100).at_rate(30.0, 110);
        let error = (4..106)
            .map(|t| (motion.displacements[[t, 0, 0]] - wave(t as f64 / 30.0)).abs())
            .fold(0.0, f32::max);
        assert!(error < 0.08, "{error}");
    }

    #[test]
    fn last_frame_is_held() {
        let motion = clip(25.0, |s| s as f32, 2).at_rate(25.0, 5);
        assert_eq!(
            motion.displacements[[4, 0, 0]],
            motion.displacements[[1, 0, 0]]
        );
    }
}
