//! When the lips are closed, according to the read-out of a speech encoder.
//!
//! Twin of `contacts` in `training/corpus/closures.py`.

use std::ops::Range;

/// Probability of a closure above which the lips start to move towards contact.
const SURE_FROM: f32 = 0.2;
/// Probability of a closure at which the lips reach contact.
const SURE_AT: f32 = 0.35;
/// Frames to either side that are searched for the highest probability.
const PEAK_FRAMES: usize = 2;
/// A frame must reach this share of that probability: the foot of a peak is no closure.
const PEAK_SHARE: f32 = 0.75;
/// Two intervals are the same if both their ends are closer than this, seconds: files round.
const SAME_S: f64 = 1e-3;

/// A span of time in which the lips touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Where it begins, seconds.
    pub start_s: f64,
    /// Where it ends, seconds.
    pub end_s: f64,
    /// How far the lips go towards contact, 0 to 1.
    pub share: f32,
    /// Whether the lips touch from start to end. Otherwise they touch at some time in between.
    pub lasts: bool,
}

/// When the lips are closed, as heard in the sound or set by an artist.
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
    /// The probability where it is near its peak, 0 elsewhere.
    probability: Vec<f32>,
    rate_hz: f64,
    /// An artist's intervals that are not in the sound.
    added: Vec<[f64; 2]>,
}

impl LipClosures {
    /// From the probability of a closure in each frame of a sound, `[T']`, frame `t` at
    /// `t / rate_hz` seconds.
    ///
    /// A frame counts if its probability is at least three quarters of the highest within two
    /// frames.
    pub fn heard(probability: &[f32], rate_hz: f64) -> LipClosures {
        LipClosures {
            probability: peaks(probability),
            rate_hz,
            added: Vec::new(),
        }
    }

    /// The times in which the lips are closed, `[start_s, end_s]` in rising order. A frame covers
    /// half a frame to either side of its time.
    pub fn intervals(&self) -> Vec<[f64; 2]> {
        let contacts = self.contacts().into_iter();
        contacts
            .map(|contact| [contact.start_s, contact.end_s])
            .collect()
    }

    /// Replaces the intervals by these. Those of the sound that are listed stay bit for bit the
    /// same, unlisted ones are removed, and new ones are added.
    #[must_use]
    pub fn mended(&self, intervals: &[[f64; 2]]) -> LipClosures {
        let near = |a: f64, b: f64| (a - b).abs() < SAME_S;
        let same = |a: &[f64; 2], b: &[f64; 2]| near(a[0], b[0]) && near(a[1], b[1]);
        let heard = LipClosures {
            added: Vec::new(),
            ..self.clone()
        };
        let known = heard.intervals();
        let mut out = heard;
        for (run, interval) in out.runs().into_iter().zip(&known) {
            if !intervals.iter().any(|target| same(target, interval)) {
                out.probability[run].fill(0.0);
            }
        }
        let new = |target: &&[f64; 2]| !known.iter().any(|interval| same(target, interval));
        out.added = intervals.iter().filter(new).copied().collect();
        out
    }

    /// The contacts of the lips, in rising order.
    ///
    /// In a closure of the sound, the highest probability decides how far the lips close (a smooth
    /// step from 0.2 to 0.35), and they touch at some time in it. In an artist's interval they
    /// touch from start to end.
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
        let added = self.added.iter().map(|&[start_s, end_s]| Contact {
            start_s,
            end_s,
            share: 1.0,
            lasts: true,
        });
        let mut all: Vec<Contact> = heard.chain(added).collect();
        all.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        all
    }

    /// Start and end of a run of frames, seconds. A frame covers half a frame to either side of its
    /// time.
    fn seconds(&self, run: &Range<usize>) -> [f64; 2] {
        [run.start, run.end].map(|frame| ((frame as f64 - 0.5) / self.rate_hz).max(0.0))
    }

    /// Runs of frames in which the sound closes the lips.
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

/// The probability where it is near its peak, 0 elsewhere.
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

/// How far the lips go towards contact for a probability of a closure, 0 to 1: a smooth step from
/// 0.2 to 0.35.
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
