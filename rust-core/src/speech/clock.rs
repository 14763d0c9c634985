//! The times of the rows of phone posteriors.

use std::ops::Range;

use super::travel::EARLY_S;

/// Converts rows to times, and back.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    pub(super) rate_hz: f64,
    pub(super) duration_s: f64,
}

impl Clock {
    /// The start of a row, seconds within the sound.
    pub(super) fn begins(self, row: usize) -> f64 {
        let time_s = (row as f64 - 0.5) / self.rate_hz - EARLY_S;
        time_s.clamp(0.0, self.duration_s)
    }

    /// The rows of a span of time, of `count` in all.
    pub(super) fn rows(self, span_s: [f64; 2], count: usize) -> Range<usize> {
        let row = |time_s: f64| ((time_s + EARLY_S) * self.rate_hz + 0.5).ceil().max(0.0) as usize;
        let [start, end] = span_s.map(|time_s| row(time_s).min(count));
        start..end.max(start)
    }
}
