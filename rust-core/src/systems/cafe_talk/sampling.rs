//! Whole clips: DDIM under guidance on overlapping windows, cross-faded.
//!
//! Twin of `training/systems/cafe_talk/sampling.py`.

use std::ops::Range;

use ndarray::{Array2, ArrayRef2, ArrayView2, Axis, Slice, s};

use super::{
    denoiser::{Coarse, Denoiser},
    priority::Priority,
    window_cache::WindowCache,
};
use crate::{
    Result,
    cache::CacheKey,
    conditions::EventTrack,
    diffusion::{Ddim, guided, mask_guided, slow_noise},
    job::{self, ProgressFn},
};

/// A request to the denoiser.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// `[T, C]`, speech features at the model's frame rate.
    pub speech: ArrayView2<'a, f32>,
    /// Number of the speaking style.
    pub style: usize,
    /// `[T, E]`, vector of the emotion in the text space.
    pub emotion: ArrayView2<'a, f32>,
    /// `[T]`.
    pub intensity: &'a [f32],
    /// Events of each of the `T` frames.
    pub events: &'a EventTrack,
    /// The same seed gives the same motion. It has no effect if the temperature is 0.
    pub seed: u64,
    /// Scale of the starting noise.
    pub temperature: f32,
    /// Denoising steps.
    pub steps: usize,
    /// Guidance of eq. 6.
    pub guidance: Guidance,
    /// Windows that were sampled earlier and need not be sampled again.
    pub window_cache: Option<&'a WindowCache>,
}

/// Weights of the conditions, eq. 6.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guidance {
    /// Speech and coarse condition.
    pub alpha: f32,
    /// Events, multiplied by their own strength.
    pub beta: f32,
    /// Whether the third term is relative to `G_∅`, as printed. Otherwise it is relative to `G_AC`.
    pub is_printed: bool,
}

impl Request<'_> {
    /// The key of a window, made from everything that the window depends on except the model.
    fn key_of(&self, rows: &Range<usize>) -> CacheKey {
        let Guidance {
            alpha,
            beta,
            is_printed,
        } = self.guidance;
        let numbers = format!(
            "{rows:?} {} {} {} {} {alpha} {beta} {is_printed} {:?}",
            self.style,
            self.seed,
            self.temperature,
            self.steps,
            &self.events.over_speech[rows.clone()]
        );
        CacheKey::new("cafe_talk_window", 1)
            .text(&numbers)
            .f32s(self.speech.slice(s![rows.clone(), ..]).iter())
            .f32s(self.emotion.slice(s![rows.clone(), ..]).iter())
            .f32s(&self.intensity[rows.clone()])
            .f32s(self.events.active.slice(s![rows.clone(), ..]).iter())
            .f32s(self.events.mask.slice(s![rows.clone(), ..]).iter())
    }
}

impl Denoiser {
    /// Samples the weights `[T, 51]` of a clip of any length, none below 0.
    ///
    /// # Errors
    /// `InvalidInput` for steps out of range, `Cancelled`.
    pub fn sample(&self, request: &Request<'_>, progress: ProgressFn<'_>) -> Result<Array2<f32>> {
        let channels = self.config().channels.len();
        let sigma = self.config().sampling.noise_s * self.config().fps;
        let noise =
            |rows: Range<usize>| slow_noise(request.seed, rows.start, rows.len(), channels, sigma);
        self.sample_from(request, noise, progress)
    }

    /// Does the same from given unit noise. `noise` gets a range of frames and returns `[T, 51]`.
    pub(super) fn sample_from(
        &self,
        request: &Request<'_>,
        noise: impl Fn(Range<usize>) -> Array2<f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let config = self.config();
        let (schedule, train_steps) = (config.diffusion.schedule, config.diffusion.train_steps);
        let ddim = Ddim::new(
            schedule,
            train_steps,
            config.sampling.spacing,
            request.steps,
        )?;
        let make = |rows: Range<usize>, done: (f32, f32)| {
            let sample = || {
                let window = Window::new(self, request, &rows);
                let start = noise(rows.clone()) * request.temperature;
                ddim.sample(start, |x, t| Ok(window.predict(x, t)), progress, done)
            };
            match request.window_cache {
                Some(cache) => cache.get_or_make(&request.key_of(&rows), sample),
                None => sample(),
            }
        };
        let frames = request.speech.nrows();
        let mut total = config
            .windows()
            .cross_faded(frames, config.channels.len(), make)?;
        self.to_weights(&mut total);
        total.mapv_inplace(|weight| weight.max(0.0));
        job::report(progress, "motion", 1.0)?;
        Ok(total)
    }
}

/// One window with everything that its denoising steps share.
struct Window<'a> {
    denoiser: &'a Denoiser,
    heard: super::denoiser::Conditions,
    /// The conditions with neither speech nor coarse condition, if the guidance needs them.
    unheard: Option<super::denoiser::Conditions>,
    /// The adapter's input, if the window has an event.
    events: Option<Array2<f32>>,
    /// βZ, `[T, 51]`.
    mask: Array2<f32>,
    /// Lowers the mask for the speech, if an event moves jaw or chin and guidance is not printed.
    priority: Option<Priority>,
    /// `[T]`, true in frames whose mask stays as it is.
    over_speech: &'a [bool],
    guidance: Guidance,
}

impl<'a> Window<'a> {
    fn new(denoiser: &'a Denoiser, request: &'a Request<'_>, rows: &Range<usize>) -> Window<'a> {
        let take =
            |x: ArrayView2<'_, f32>| x.slice_axis(Axis(0), Slice::from(rows.clone())).to_owned();
        let (speech, emotion) = (take(request.speech), take(request.emotion));
        let coarse = Coarse {
            style: request.style,
            emotion: emotion.view(),
            intensity: &request.intensity[rows.clone()],
        };
        let guidance = request.guidance;
        let mask = guidance.beta * &request.events.mask.slice(s![rows.clone(), ..]);
        let is_controlled = mask.iter().any(|strength| *strength != 0.0);
        let needs_null = guidance.alpha != 1.0 || (is_controlled && guidance.is_printed);
        let frames = rows.len();
        let priority = Priority::new(&denoiser.config().channels);
        Window {
            denoiser,
            heard: denoiser.conditions(frames, Some(speech.view()), Some(coarse)),
            unheard: needs_null.then(|| denoiser.conditions(frames, None, None)),
            events: is_controlled.then(|| {
                let active = request.events.active.slice(s![rows.clone(), ..]);
                denoiser.events(active)
            }),
            priority: (!guidance.is_printed && priority.concerns(&mask)).then_some(priority),
            over_speech: &request.events.over_speech[rows.clone()],
            mask,
            guidance,
        }
    }

    fn predict(&self, x: &ArrayRef2<f32>, timestep: usize) -> Array2<f32> {
        let pass = |conditions, events| self.denoiser.denoise(x, timestep, conditions, events);
        let heard = pass(&self.heard, None);
        let unheard = self
            .unheard
            .as_ref()
            .map(|conditions| pass(conditions, None));
        let mut out = match &unheard {
            Some(unheard) if self.guidance.alpha != 1.0 => {
                guided(unheard, &heard, self.guidance.alpha)
            }
            _ => heard.clone(),
        };
        if let Some(events) = &self.events {
            let fine = pass(&self.heard, Some(events));
            let other = match (&unheard, self.guidance.is_printed) {
                (Some(unheard), true) => unheard,
                _ => &heard,
            };
            match &self.priority {
                Some(priority) => {
                    let (mut mask, mut spoken) = (self.mask.clone(), heard.clone());
                    self.denoiser.to_weights(&mut spoken);
                    priority.give_way(&mut mask, &spoken, self.over_speech);
                    mask_guided(&mut out, &fine, other, &mask);
                }
                None => mask_guided(&mut out, &fine, other, &self.mask),
            }
        }
        out
    }
}
