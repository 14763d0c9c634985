//! Lips that touch where the sound says p, b or m.
//!
//! Whatever is trained by squared error blurs closure, which lasts a frame or two; the speech
//! encoder's own read-out of it does not. Twin of `lips_closed` in
//! `training/corpus/closures.py`.

use std::ops::Range;

use super::LandmarkClip;
use crate::ibug::{INNER_LIPS, OUTER_LIPS};

/// Probabilities between which the lips go from as they are to touching.
const SURE_FROM: f32 = 0.2;
const SURE_AT: f32 = 0.35;
/// Frames to either side among which a probability has to come near the highest, and how near: the
/// foot of a peak is no closure.
const PEAK_FRAMES: usize = 2;
const PEAK_SHARE: f32 = 0.75;
/// Opening over that of the neutral face at which lips touch in speech, metres.
const TOUCHING: f32 = -0.5e-3;
/// Of each outer pair the inner pair that it follows, and how far.
const FOLLOWS: [(usize, f32); 5] = [(0, 0.4), (0, 0.8), (1, 1.0), (2, 0.8), (2, 0.4)];
/// Part of a closing motion that the upper lip makes.
const UPPER_SHARE: f32 = 0.35;

/// An interval is the one that was heard where both its ends lie so near to it, seconds: what a file
/// rounds.
const SAME_S: f64 = 1e-3;
/// Time in which lips come together before an interval that was given, and part after it, seconds.
const APPROACH_S: f64 = 0.02;

/// When lips are together: where the sound says so, or where an artist does.
///
/// ```
/// use anyface::motion::LipClosures;
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

/// Closes the lips of a clip.
///
/// [`LipClosures::share`] decides how far the gap of each inner pair goes to where lips touch, and how
/// far one lip comes forward to the other; it never widens. Frames where nothing closes stay as the network
/// made them, which moves as recorded lips do, and so do the corners.
pub fn close_lips(clip: &mut LandmarkClip, closures: &LipClosures) {
    let fps = clip.fps;
    for (t, mut face) in clip.displacements.outer_iter_mut().enumerate() {
        let share = closures.share(t as f64 / fps, 1.0 / fps);
        if share == 0.0 {
            continue;
        }
        let by = INNER_LIPS.map(|(upper, lower)| {
            let apart = |axis| face[[upper, axis]] - face[[lower, axis]];
            [share * (apart(1) - TOUCHING).max(0.0), share * apart(2)]
        });
        let mut narrow = |(upper, lower): (usize, usize), [height, depth]: [f32; 2], part: f32| {
            for (axis, by) in [(1, part * height), (2, part * depth)] {
                face[[upper, axis]] -= UPPER_SHARE * by;
                face[[lower, axis]] += (1.0 - UPPER_SHARE) * by;
            }
        };
        for (pair, by) in INNER_LIPS.into_iter().zip(by) {
            narrow(pair, by, 1.0);
        }
        for (pair, (follows, part)) in OUTER_LIPS.into_iter().zip(FOLLOWS) {
            narrow(pair, by[follows], part);
        }
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
    use ndarray::Array3;

    use super::*;

    /// Frames of an open mouth, 10 mm at the inner lips.
    fn open(frames: usize, fps: f64) -> LandmarkClip {
        let mut displacements = Array3::zeros((frames, 68, 3));
        for mut frame in displacements.outer_iter_mut() {
            for lower in [55, 56, 57, 58, 59, 65, 66, 67] {
                frame[[lower, 1]] = -0.01;
            }
        }
        LandmarkClip { displacements, fps }
    }

    fn gap(clip: &LandmarkClip, t: usize, (upper, lower): (usize, usize)) -> f32 {
        clip.displacements[[t, upper, 1]] - clip.displacements[[t, lower, 1]]
    }

    #[test]
    fn sure_closures_touch_and_unlikely_ones_change_nothing() {
        let mut clip = open(3, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[0.9, 0.1, 0.1], 25.0));
        for pair in INNER_LIPS {
            assert!((gap(&clip, 0, pair) - TOUCHING).abs() < 1e-7);
        }
        let later = |clip: &LandmarkClip| {
            clip.displacements
                .slice(ndarray::s![1.., .., ..])
                .to_owned()
        };
        assert_eq!(later(&clip), later(&open(3, 25.0)));
    }

    #[test]
    fn lips_that_close_meet_in_depth_too() {
        let mut clip = open(1, 25.0);
        for lower in [65, 66, 67] {
            clip.displacements[[0, lower, 2]] = -0.003;
        }
        close_lips(&mut clip, &LipClosures::heard(&[0.9], 25.0));
        for (upper, lower) in INNER_LIPS {
            let apart = clip.displacements[[0, upper, 2]] - clip.displacements[[0, lower, 2]];
            assert!(apart.abs() < 1e-7, "{apart}");
        }
    }

    #[test]
    fn a_closure_of_one_frame_is_met_at_any_rate() {
        for fps in [24.0, 25.0, 29.97, 30.0, 48.0, 60.0] {
            for at in 3..12 {
                let mut clip = open(fps as usize, fps);
                let mut probability = [0.0; 25];
                probability[at] = 0.9;
                close_lips(&mut clip, &LipClosures::heard(&probability, 25.0));
                let gaps = (0..fps as usize).map(|t| gap(&clip, t, INNER_LIPS[1]));
                let least = gaps.fold(f32::INFINITY, f32::min);
                assert!(
                    least < 0.0,
                    "{fps} frames a second, closure at {at}: {least}"
                );
            }
        }
    }

    #[test]
    fn lips_that_are_closer_already_stay() {
        let mut clip = open(1, 25.0);
        clip.displacements.fill(0.0);
        for lower in [65, 66, 67] {
            clip.displacements[[0, lower, 1]] = 0.002;
        }
        let before = clip.clone();
        close_lips(&mut clip, &LipClosures::heard(&[1.0], 25.0));
        assert_eq!(clip, before);
    }

    #[test]
    fn corners_and_the_rest_of_the_face_stay() {
        let mut clip = open(1, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[1.0], 25.0));
        let (made, before) = (clip.displacements, open(1, 25.0).displacements);
        let found: Vec<usize> = (0..68)
            .filter(|n| made[[0, *n, 1]] != before[[0, *n, 1]])
            .collect();
        assert_eq!(
            found,
            [
                49, 50, 51, 52, 53, 55, 56, 57, 58, 59, 61, 62, 63, 65, 66, 67
            ]
        );
    }

    #[test]
    fn the_foot_of_a_peak_closes_nothing() {
        let mut clip = open(5, 25.0);
        close_lips(
            &mut clip,
            &LipClosures::heard(&[0.0, 0.5, 0.9, 0.8, 0.3], 25.0),
        );
        let closed: Vec<bool> = (0..5).map(|t| gap(&clip, t, INNER_LIPS[1]) < 0.0).collect();
        assert_eq!(closed, [false, false, true, true, false]);
    }

    #[test]
    fn closing_is_the_same_on_both_sides() {
        let mut clip = open(1, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[0.3], 25.0));
        for (left, right) in [(61, 63), (67, 65), (49, 53), (59, 55), (50, 52), (58, 56)] {
            assert_eq!(
                clip.displacements[[0, left, 1]],
                clip.displacements[[0, right, 1]]
            );
        }
    }

    #[test]
    fn without_a_probability_nothing_closes() {
        let mut clip = open(3, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[], 25.0));
        assert_eq!(clip, open(3, 25.0));
    }

    #[test]
    fn intervals_are_runs_of_frames() {
        let heard = LipClosures::heard(&[0.9, 0.0, 0.0, 0.0, 0.8, 0.9, 0.0, 0.0, 0.1], 25.0);
        assert_eq!(heard.intervals(), [[0.0, 0.02], [0.14, 0.22]]);
    }

    #[test]
    fn what_was_heard_and_given_back_closes_the_same_to_the_bit() {
        let heard = LipClosures::heard(&[0.1, 0.3, 0.9, 0.8, 0.15, 0.0, 0.0, 0.28, 0.1], 25.0);
        let mended = heard.mended(&heard.intervals());
        let (mut plain, mut again) = (open(20, 60.0), open(20, 60.0));
        close_lips(&mut plain, &heard);
        close_lips(&mut again, &mended);
        assert_ne!(plain, open(20, 60.0));
        assert_eq!(plain, again);
    }

    #[test]
    fn a_closure_moves_goes_and_comes() {
        let mut probability = [0.0; 50];
        (probability[10], probability[30]) = (0.9, 0.9);
        let heard = LipClosures::heard(&probability, 25.0);
        // The first is moved by a fifth of a second, the second goes.
        let mended = heard.mended(&[[0.58, 0.62]]);
        let mut clip = open(50, 25.0);
        close_lips(&mut clip, &mended);
        let closed: Vec<usize> = (0..50)
            .filter(|t| gap(&clip, *t, INNER_LIPS[1]) < 0.0)
            .collect();
        assert_eq!(closed, [15]);
        assert_eq!(mended.intervals(), [[0.58, 0.62]]);
        assert_eq!(heard.mended(&[]).intervals(), [] as [[f64; 2]; 0]);
    }

    #[test]
    fn a_given_interval_is_met_at_any_rate() {
        for fps in [12.0, 24.0, 25.0, 29.97, 60.0] {
            for at in 0..20 {
                let start = 0.3 + 0.007 * f64::from(at);
                let given = LipClosures::heard(&[], 25.0).mended(&[[start, start + 0.01]]);
                let mut clip = open(fps as usize, fps);
                close_lips(&mut clip, &given);
                let gaps = (0..fps as usize).map(|t| gap(&clip, t, INNER_LIPS[1]));
                assert!(gaps.fold(f32::INFINITY, f32::min) < 0.0, "{fps}, {start}");
            }
        }
    }
}
