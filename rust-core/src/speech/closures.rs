//! When lips are together, as a speech encoder's own read-out has it.
//!
//! Twin of `contacts` in `training/corpus/closures.py`.

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

/// A time in which lips touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Where it begins, seconds.
    pub start_s: f64,
    /// Where it ends, seconds.
    pub end_s: f64,
    /// How far the lips go to touching, 0 to 1.
    pub share: f32,
    /// The lips touch from start to end. Otherwise they touch somewhere between the two.
    pub lasts: bool,
}

/// When lips are together: where the sound says so, or where an artist does.
///
/// ```
/// use anyface::speech::LipClosures;
///
/// let heard = LipClosures::heard(&[0.0, 0.9, 0.9, 0.0, 0.0], 25.0);
/// assert_eq!(heard.intervals(), [[0.02, 0.1]]);
/// let mended = heard.mended(&[[0.12, 0.16]]);
/// let contact = mended.contacts()[0];
/// assert_eq!((contact.start_s, contact.share, contact.lasts), (0.12, 1.0, true));
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
    /// A frame counts where its probability is three quarters of the highest within two frames.
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
        let contacts = self.contacts().into_iter();
        contacts
            .map(|contact| [contact.start_s, contact.end_s])
            .collect()
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

    /// Where lips touch, in rising order.
    ///
    /// What is heard goes as far as its highest probability says: a smooth step from 0.2 to 0.35. The lips touch
    /// somewhere in it. An interval that an artist sets lasts from its start to its end.
    pub fn contacts(&self) -> Vec<Contact> {
        let heard = self.runs().into_iter().map(|run| {
            let highest = self.probability[run.clone()]
                .iter()
                .fold(0.0, |a: f32, b| a.max(*b));
            let [start_s, end_s] = self.seconds(&run);
            Contact {
                start_s,
                end_s,
                share: closure_share(highest),
                lasts: false,
            }
        });
        let given = self.given.iter().map(|&[start_s, end_s]| Contact {
            start_s,
            end_s,
            share: 1.0,
            lasts: true,
        });
        let mut all: Vec<Contact> = heard.chain(given).collect();
        all.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        all
    }

    /// Where a run of frames begins and ends: each frame lasts half of one to either side.
    fn seconds(&self, run: &Range<usize>) -> [f64; 2] {
        [run.start, run.end].map(|frame| ((frame as f64 - 0.5) / self.rate_hz).max(0.0))
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

/// How far the lips go to touching where a closure is so likely, 0 to 1: a smooth step from 0.2 to 0.35.
pub fn closure_share(probability: f32) -> f32 {
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
