//! The baselines that a model has to beat: a still face, and a face that follows loudness.

use ndarray::{Array2, Array3};

use super::clip::Clip;
use anyface::{
    Error, Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
    mesh::ibug::LANDMARKS,
};

/// Half the length of the window in which loudness is measured, seconds.
const HALF_WINDOW_S: f64 = 0.04;

/// Both baselines, fitted to the source's own training clips to make them as strong as possible.
pub(super) struct Baselines {
    /// `[68, 3]`, mean displacement.
    mean: Array2<f64>,
    /// `[68, 3]`, displacement per unit of loudness above its mean.
    slope: Array2<f64>,
    mean_loudness: f64,
}

impl Baselines {
    /// Fits the mean face, and by least squares a line of every coordinate over loudness.
    pub(super) fn fit(clips: &[Clip]) -> Result<Self> {
        let frames: usize = clips.iter().map(Clip::frames).sum();
        if frames == 0 {
            return Err(Error::InvalidInput(
                "expected training clips, got none".into(),
            ));
        }
        let curves: Vec<Vec<f64>> = clips.iter().map(loudness_of).collect();
        let mean_loudness = curves.iter().flatten().sum::<f64>() / frames as f64;
        let mut mean = Array2::zeros((LANDMARKS, 3));
        let mut slope = Array2::zeros((LANDMARKS, 3));
        let mut power = 0.0;
        for (clip, curve) in clips.iter().zip(&curves) {
            for (frame, level) in clip.motion.outer_iter().zip(curve) {
                mean += &frame;
                slope.scaled_add(level - mean_loudness, &frame);
                power += (level - mean_loudness).powi(2);
            }
        }
        Ok(Baselines {
            mean: mean / frames as f64,
            slope: slope / power.max(f64::MIN_POSITIVE),
            mean_loudness,
        })
    }

    /// The mean face in every frame.
    pub(super) fn constant(&self, clip: &Clip) -> Array3<f64> {
        Array3::from_shape_fn(clip.motion.dim(), |(_, n, i)| self.mean[[n, i]])
    }

    /// The face that loudness alone predicts.
    pub(super) fn loudness(&self, clip: &Clip) -> Array3<f64> {
        let curve = loudness_of(clip);
        Array3::from_shape_fn(clip.motion.dim(), |(t, n, i)| {
            self.mean[[n, i]] + self.slope[[n, i]] * (curve[t] - self.mean_loudness)
        })
    }
}

fn loudness_of(clip: &Clip) -> Vec<f64> {
    loudness(&clip.waveform, clip.frames(), clip.fps)
}

/// Square root of the root mean square around every frame, relative to the clip's largest.
///
/// The square root comes close to how loud the sound seems (Stevens's law). Dividing by the largest
/// value removes the level of the recording.
fn loudness(waveform: &Waveform, frames: usize, fps: f64) -> Vec<f64> {
    let rate = f64::from(SAMPLE_RATE_HZ);
    let count = waveform.samples.len();
    let curve: Vec<f64> = (0..frames)
        .map(|t| {
            let at = |seconds: f64| ((seconds * rate).max(0.0) as usize).min(count);
            let centre_s = t as f64 / fps;
            let window =
                &waveform.samples[at(centre_s - HALF_WINDOW_S)..at(centre_s + HALF_WINDOW_S)];
            let power: f64 = window.iter().map(|x| f64::from(*x).powi(2)).sum();
            (power / window.len().max(1) as f64).powf(0.25)
        })
        .collect();
    let most = curve.iter().copied().fold(1e-9, f64::max);
    curve.into_iter().map(|level| level / most).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics;

    /// A chin that falls with loudness, 2 s at 25 fps.
    fn clip() -> Clip {
        let samples: Vec<f32> = (0..32_000)
            .map(|i| (i as f32 * 0.5).sin() * (i as f32 / 32_000.0))
            .collect();
        let waveform = Waveform { samples };
        let level = loudness(&waveform, 50, 25.0);
        let mut motion = Array3::zeros((50, LANDMARKS, 3));
        for t in 0..50 {
            motion[[t, 66, 1]] = -0.01 * level[t];
        }
        Clip {
            name: "test".into(),
            waveform,
            start_s: 0.0,
            motion,
            speaker: Array2::zeros((LANDMARKS, 3)),
            neutral: Array2::zeros((LANDMARKS, 3)),
            fps: 25.0,
            observed: (0..LANDMARKS).collect(),
            judged: 0..50,
            phones: None,
        }
    }

    #[test]
    fn loudness_rises_with_the_sound_and_ignores_its_level() {
        let clip = clip();
        let curve = loudness(&clip.waveform, 50, 25.0);
        assert!(curve.windows(2).skip(2).take(40).all(|w| w[1] > w[0]));
        let quiet = Waveform {
            samples: clip.waveform.samples.iter().map(|x| x * 0.1).collect(),
        };
        let other = loudness(&quiet, 50, 25.0);
        assert!(curve.iter().zip(&other).all(|(a, b)| (a - b).abs() < 1e-4));
    }

    #[test]
    fn a_jaw_that_follows_loudness_is_found_exactly() {
        let clip = clip();
        let baselines = Baselines::fit(std::slice::from_ref(&clip)).unwrap();
        let prediction = baselines.loudness(&clip);
        let error = metrics::mean_vertex_error(prediction.view(), clip.motion.view()).unwrap();
        assert!(error < 1e-9, "{error}");
        let still = baselines.constant(&clip);
        assert_eq!(still[[0, 66, 1]], still[[49, 66, 1]]);
        assert!(Baselines::fit(&[]).is_err());
    }
}
