//! How an emotion changes articulation.

use ndarray::{ArrayView2, ArrayViewMut2};

use crate::mesh::ibug::{MOUTH, speaking};

/// Limits of the share of smoothed motion.
const SLUR: (f32, f32) = (-0.6, 0.9);
const SMALLEST_GAIN: f32 = 0.3;

/// Factors on neutral speech motion, for an emotion at intensity 1 or for a mixture.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize)]
pub(super) struct Manner {
    /// Scales jaw and lips up and down.
    pub(super) opening: f32,
    /// Scales the lips' width and protrusion.
    pub(super) rounding: f32,
    /// Share of smoothed motion; negative where speech gets crisper.
    pub(super) slur: f32,
    /// Nine tenths of a change are done after this time, seconds.
    pub(super) onset_s: f64,
}

impl Manner {
    /// Speaks a frame in this manner. `frame`, `smooth`: `[68, 3]`, canonical metres, as spoken and
    /// smoothed over time. `free` is 0 where the lips close, so that smoothing does not blur a closure.
    pub(super) fn speak(
        &self,
        frame: &mut ArrayViewMut2<'_, f32>,
        smooth: ArrayView2<'_, f32>,
        free: f32,
    ) {
        let share = free * self.slur.clamp(SLUR.0, SLUR.1);
        let opening = self.opening.max(SMALLEST_GAIN);
        let rounding = self.rounding.max(SMALLEST_GAIN);
        for n in speaking() {
            let sideways = if MOUTH.contains(&n) { rounding } else { 1.0 };
            for (axis, gain) in [sideways, opening, sideways].into_iter().enumerate() {
                let spoken = frame[[n, axis]];
                frame[[n, axis]] = gain * (spoken + share * (smooth[[n, axis]] - spoken));
            }
        }
    }
}
