//! The running normalisation: removes loudness, microphone and voice colour, judged by the sound so
//! far.

use super::config::NormaliserConfig;
use crate::speech::BANDS;

const QUANTILE: f32 = 0.95;
/// Frames at most this far below the peak are the voice, nepers.
const ACTIVE_RANGE: f32 = 4.0;
/// The quietest level that counts as a voice, nepers.
const QUIETEST_LEVEL: f32 = -9.0;
/// Bounds a normalised log-mel below, and divides it.
const DEEPEST: f32 = -12.0;
const SCALE: f32 = 4.0;

/// Twin of `normalise_running` in `training/speech/causal.py`.
///
/// The level of a frame is its mean over bands. `peak` follows the 95 % quantile of levels in steps:
/// up by 0.95 or down by 0.05 of a step size, which shrinks while the first voice is heard. Frames
/// at most 4 nepers below the peak, and not below −9, update the colour: a mean that starts from the
/// prior and forgets after `memory_frames`. If the colour's mean is below the peak minus
/// `peak_over_level`, or below −9, it is raised to that.
#[derive(Debug, Clone)]
pub(super) struct RunningNormaliser {
    config: NormaliserConfig,
    colour: [f32; BANDS],
    peak: f32,
    frames: f32,
}

impl RunningNormaliser {
    /// The state before any sound.
    pub fn new(config: &NormaliserConfig) -> Self {
        RunningNormaliser {
            colour: std::array::from_fn(|band| config.prior_colour[band]),
            peak: config.prior_peak,
            frames: 0.0,
            config: config.clone(),
        }
    }

    /// Normalises the next frame of raw log-mel in place. Returns whether it is loud enough to be
    /// the voice.
    pub fn hear(&mut self, row: &mut [f32; BANDS]) -> bool {
        let config = &self.config;
        let level = mean(row);
        let fresh = (1.0 - self.frames / config.start_frames).max(0.0);
        let step = config.step + (config.start_step - config.step) * fresh;
        let share = if level > self.peak {
            QUANTILE
        } else {
            QUANTILE - 1.0
        };
        self.peak += step * share;
        let is_active = level >= (self.peak - ACTIVE_RANGE).max(QUIETEST_LEVEL);
        if is_active {
            self.frames = (self.frames + 1.0).min(config.memory_frames);
            let rate = 1.0 / (self.frames + config.prior_frames).min(config.memory_frames);
            for (colour, x) in self.colour.iter_mut().zip(row.iter()) {
                *colour += rate * (x - *colour);
            }
        }
        let least = (self.peak - config.peak_over_level).max(QUIETEST_LEVEL);
        let raise = (least - mean(&self.colour)).max(0.0);
        for (x, colour) in row.iter_mut().zip(&self.colour) {
            *x = (*x - (colour + raise)).max(DEEPEST) / SCALE;
        }
        is_active
    }
}

fn mean(row: &[f32; BANDS]) -> f32 {
    row.iter().sum::<f32>() / BANDS as f32
}
