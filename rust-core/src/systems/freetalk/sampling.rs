//! Whole clips from the denoiser: DDIM on overlapping windows, cross-faded.
//!
//! Twin of `training/systems/freetalk/sampling.py`. It takes time linear in the length of the clip
//! and the working memory of one window.

use std::ops::Range;

use ndarray::{Array2, Array3, ArrayRef2, ArrayView2, Axis, Slice};

use super::ats::{Ats, Sampling};
use crate::{
    Error, Result,
    conditions::EMOTIONS,
    diffusion::{Ddim, slow_noise},
    job::{self, ProgressFn},
    motion::style_number,
};

/// A request to the denoiser.
#[derive(Debug, Clone, Copy)]
pub struct AtsRequest<'a> {
    /// `[T, C]`, speech features at the model's frame rate.
    pub speech: ArrayView2<'a, f32>,
    /// `[T, 16]`, a mixture of 15 emotions and an intensity for each frame.
    pub affect: ArrayView2<'a, f32>,
    /// Speaking style by name; `None` takes the model's default.
    pub style: Option<&'a str>,
    /// The same seed gives the same motion. It has no effect if the temperature is 0.
    pub seed: u64,
    /// Denoising steps; `None` takes the model's default.
    pub steps: Option<usize>,
    /// Scale of the starting noise; `None` takes the model's default.
    pub temperature: Option<f32>,
}

impl Ats {
    /// Samples landmark displacements of a clip of any length, `[T, 68, 3]`, canonical metres.
    ///
    /// # Errors
    /// `ShapeMismatch` if speech or affect have other channels or lengths; `InvalidInput` for an
    /// unknown style, steps out of range or a temperature that is negative or not finite;
    /// `Cancelled`.
    pub fn sample(
        &self,
        request: &AtsRequest<'_>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let channels = self.config().motion_channels();
        let sigma = self.config().sampling.noise_s * self.config().fps;
        let noise =
            |rows: Range<usize>| slow_noise(request.seed, rows.start, rows.len(), channels, sigma);
        let motion = self.sample_from(request, noise, progress)?;
        let shape = (motion.nrows(), self.config().landmarks, 3);
        Ok(motion
            .into_shape_with_order(shape)
            .expect("three channels a landmark"))
    }

    /// Samples from given unit noise: `noise` gets a range of frames and returns `[T, 204]`.
    ///
    /// The noise belongs to the frame, not to the window, so that overlapping windows start from
    /// the same noise. Where they overlap, their results are cross-faded: averaged with weights
    /// that form a ramp.
    fn sample_from(
        &self,
        request: &AtsRequest<'_>,
        noise: impl Fn(Range<usize>) -> Array2<f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let (config, style) = (self.config(), self.check(request)?);
        let Sampling {
            steps,
            spacing,
            temperature,
            ..
        } = config.sampling;
        let (schedule, train_steps) = (config.diffusion.schedule, config.diffusion.train_steps);
        let ddim = Ddim::new(
            schedule,
            train_steps,
            spacing,
            request.steps.unwrap_or(steps),
        )?;
        let temperature = request.temperature.unwrap_or(temperature);

        let frames = request.speech.nrows();
        let make = |rows: Range<usize>, done: (f32, f32)| {
            let take = |x: ArrayView2<'_, f32>| x.slice_axis(Axis(0), slice(&rows)).to_owned();
            let (speech, affect) = (take(request.speech), take(request.affect));
            let context = self.window(speech.view(), affect.view(), style);
            let predict = |x: &ArrayRef2<f32>, t| Ok(self.denoise(x, t, &context));
            let start = noise(rows.clone()) * temperature;
            ddim.sample(start, predict, progress, done)
        };
        let channels = config.motion_channels();
        let mut total = config.windows().cross_faded(frames, channels, make)?;
        self.to_metres(&mut total);
        job::report(progress, "motion", 1.0)?;
        Ok(total)
    }

    /// Checks a request and returns the number of its style.
    fn check(&self, request: &AtsRequest<'_>) -> Result<usize> {
        let config = self.config();
        let frames = request.speech.nrows();
        let arrays = [
            ("speech features", request.speech, config.speech.channels),
            ("emotion conditions", request.affect, EMOTIONS.len() + 1),
        ];
        for (what, array, channels) in arrays {
            if array.dim() != (frames, channels) {
                return Err(Error::ShapeMismatch {
                    what,
                    expected: format!("[{frames}, {channels}]"),
                    got: format!("{:?}", array.shape()),
                });
            }
        }
        let temperature = request.temperature.unwrap_or(0.0);
        if !(temperature.is_finite() && temperature >= 0.0) {
            return Err(Error::InvalidInput(format!(
                "temperature: expected a number of at least 0, got {temperature}"
            )));
        }
        style_number(request.style, &config.styles, &config.default_style)
    }
}

fn slice(rows: &Range<usize>) -> Slice {
    Slice::from(rows.clone())
}

#[cfg(test)]
mod tests;
