//! Motion at another frame rate.

use ndarray::{Array3, Axis, Zip};

use super::LandmarkClip;

impl LandmarkClip {
    /// The same motion as `frames` frames at `fps`; frame `t` stands at `t / fps` seconds.
    ///
    /// Catmull-Rom between the four nearest frames, so that velocity has no steps; held beyond the
    /// last frame. Between frames it may overshoot by an eighth of a step, which keeps peaks.
    pub fn at_rate(&self, fps: f64, frames: usize) -> LandmarkClip {
        let (count, landmarks, axes) = self.displacements.dim();
        let mut out = Array3::zeros((frames, landmarks, axes));
        if count == 0 {
            return LandmarkClip {
                displacements: out,
                fps,
            };
        }
        let last = count - 1;
        for (t, frame) in out.outer_iter_mut().enumerate() {
            let position = (t as f64 * self.fps / fps).min(last as f64);
            let before = position.floor() as usize;
            let weights = catmull_rom((position - before as f64) as f32);
            let source = |offset: usize| (before + offset).saturating_sub(1).min(last);
            let mut frame = frame;
            for (offset, weight) in weights.into_iter().enumerate() {
                let from = self.displacements.index_axis(Axis(0), source(offset));
                Zip::from(&mut frame)
                    .and(from)
                    .for_each(|to, from| *to += weight * from);
            }
        }
        LandmarkClip {
            displacements: out,
            fps,
        }
    }
}

/// Weights of the frames at −1, 0, 1 and 2 for a point `u` of the way from 0 to 1.
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
            let wanted = 3.0 * t as f32 / 30.0;
            assert!(
                (motion.displacements[[t, 5, 1]] - wanted).abs() < 1e-5,
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
