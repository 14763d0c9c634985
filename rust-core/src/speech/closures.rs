//! When lips are together, as a speech encoder's own read-out has it.
//!
//! Twin of `lips_closed` in `training/corpus/closures.py`, where `motion::close_lips` is the other half.

use std::ops::Range;

/// Probabilities between which the lips go from as they are to touching.
const SURE_FROM: f32 = 0.2;
const SURE_AT: f32 = 0.35;
/// Frames to either side among which a probability has to come near the highest, and how near: the
/// foot of a peak is no closure.
const PEAK_FRAMES: usize = 2;
const PEAK_SHARE: f32 = 0.75;
/// An interval is the one that was heard where both its ends lie so near to it, seconds: what a file
/// rounds.
const SAME_S: f64 = 1e-3;
/// Time in which lips come together before an interval that was given, and part after it, seconds.
const APPROACH_S: f64 = 0.02;

/// When lips are together: where the sound says so, or where an artist does.
///
/// ```
/// use anyface::speech::LipClosures;
///
/// let heard = LipClosures::heard(&[0.0, 0.9, 0.9, 0.0, 0.0], 25.0);
/// assert_eq!(heard.intervals(), [[0.02, 0.1]]);
/// let mended = heard.mended(&[[0.12, 0.16]]);
/// assert_eq!((mended.share(0.04, 0.04), mended.share(0.14, 0.04)), (0.0, 1.0));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct LipClosures {
    /// Probability where it comes near its highest, 0 elsewhere.
    probability: Vec<f32>,
    rate_hz: f64,
    /// Intervals that nobody heard.
    given: Vec<[f64; 2]>,
}

impl LipClosures {
    /// What is heard: `probability` `[T']`, frame `t` at `t / rate_hz` seconds.
    ///
    /// Where the probability is three quarters of the highest within two frames, a smooth step from 0.2
    /// to 0.35 decides how far the lips go. Between its frames the probability goes straight, so that a
    /// closure of one of them is met at any frame rate.
    pub fn heard(probability: &[f32], rate_hz: f64) -> LipClosures {
        LipClosures {
            probability: peaks(probability),
            rate_hz,
            given: Vec::new(),
        }
    }

    /// Where lips go together, `[start_s, end_s]` in rising order; each frame lasts half of one to
    /// either side.
    pub fn intervals(&self) -> Vec<[f64; 2]> {
        let seconds = |frame: f64| (frame / self.rate_hz).max(0.0);
        let heard = self.runs().into_iter();
        let heard = heard.map(|run| {
            [
                seconds(run.start as f64 - 0.5),
                seconds(run.end as f64 - 0.5),
            ]
        });
        let mut all: Vec<[f64; 2]> = heard.chain(self.given.iter().copied()).collect();
        all.sort_by(|a, b| a[0].total_cmp(&b[0]));
        all
    }

    /// The same with these intervals instead: those that were heard stay to the bit, those that are not
    /// among them go, others come.
    #[must_use]
    pub fn mended(&self, intervals: &[[f64; 2]]) -> LipClosures {
        let near = |a: f64, b: f64| (a - b).abs() < SAME_S;
        let same = |a: &[f64; 2], b: &[f64; 2]| near(a[0], b[0]) && near(a[1], b[1]);
        let heard = LipClosures {
            given: Vec::new(),
            ..self.clone()
        };
        let known = heard.intervals();
        let mut out = heard;
        for (run, interval) in out.runs().into_iter().zip(&known) {
            if !intervals.iter().any(|given| same(given, interval)) {
                out.probability[run].fill(0.0);
            }
        }
        let new = |given: &&[f64; 2]| !known.iter().any(|interval| same(given, interval));
        out.given = intervals.iter().filter(new).copied().collect();
        out
    }

    /// How far lips go to touching at a moment, 0 to 1, in motion whose frames lie `step_s` apart; an
    /// interval that is shorter is met by one of them.
    pub fn share(&self, time_s: f64, step_s: f64) -> f32 {
        let heard = smooth_step(between(&self.probability, time_s * self.rate_hz));
        let given = self.given.iter().map(|[start, end]| {
            let half = 0.5 * (end - start).max(step_s);
            let beyond = (time_s - 0.5 * (start + end)).abs() - half;
            let x = (1.0 - beyond / APPROACH_S).clamp(0.0, 1.0) as f32;
            x * x * (3.0 - 2.0 * x)
        });
        given.fold(heard, f32::max)
    }

    /// [`LipClosures::share`] at each frame of a clip, `[T]`; 0 where an event is `over_speech`.
    pub(crate) fn shares(&self, frames: usize, fps: f64, over_speech: &[bool]) -> Vec<f32> {
        let step_s = 1.0 / fps;
        let share = |t: usize| match over_speech.get(t) {
            Some(true) => 0.0,
            _ => self.share(t as f64 * step_s, step_s),
        };
        (0..frames).map(share).collect()
    }

    /// Frames in which lips move because of what was heard, without a gap.
    fn runs(&self) -> Vec<Range<usize>> {
        let mut out: Vec<Range<usize>> = Vec::new();
        let moves = |(_, p): &(usize, &f32)| **p > SURE_FROM;
        for (t, _) in self.probability.iter().enumerate().filter(moves) {
            match out.last_mut() {
                Some(run) if run.end == t => run.end += 1,
                _ => out.push(t..t + 1),
            }
        }
        out
    }
}

/// The probability where it comes near its highest, 0 elsewhere.
fn peaks(probability: &[f32]) -> Vec<f32> {
    let near_highest = |(t, &here): (usize, &f32)| {
        let last = (t + PEAK_FRAMES + 1).min(probability.len());
        let around = &probability[t.saturating_sub(PEAK_FRAMES)..last];
        let highest = around.iter().fold(0.0f32, |a, b| a.max(*b));
        if here >= PEAK_SHARE * highest {
            here
        } else {
            0.0
        }
    };
    probability.iter().enumerate().map(near_highest).collect()
}

/// A track at a fractional frame, held beyond its end; 0 where it is empty.
fn between(track: &[f32], position: f64) -> f32 {
    let Some(last) = track.len().checked_sub(1) else {
        return 0.0;
    };
    let position = position.min(last as f64);
    let before = position.floor() as usize;
    let share = (position - before as f64) as f32;
    track[before] + share * (track[(before + 1).min(last)] - track[before])
}

/// How far the lips go to touching.
fn smooth_step(probability: f32) -> f32 {
    let x = ((probability - SURE_FROM) / (SURE_AT - SURE_FROM)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_runs_of_frames() {
        let heard = LipClosures::heard(&[0.9, 0.0, 0.0, 0.0, 0.8, 0.9, 0.0, 0.0, 0.1], 25.0);
        assert_eq!(heard.intervals(), [[0.0, 0.02], [0.14, 0.22]]);
    }
}
