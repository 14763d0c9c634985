//! Blinks of both eyes, at random but more often where the voice pauses.
//!
//! Twenty of 100 blinks are double. The lids close in 60 ms, open fast for 120 ms and slowly for
//! another 180 ms, and the two eyes open up to 20 ms apart. The tracked lids of grid_s1 do the same:
//! a fifth of their blinks follow another one within 0.3 s. Speakers blink at the ends of phrases and
//! in pauses (Nakano & Kitazawa 2010; in grid_s1 four times as often just before a phrase ends as
//! elsewhere) and with large leaps of the eyes (Evinger et al. 1994). They blink more often when sad
//! or angry than when afraid. Intervals are drawn from a bell between a quarter and seven quarters
//! of their mean, 1.2 to 8.4 s at the default rate, so that blinks neither tick like a clock nor
//! bunch up.

use std::ops::Range;

use ndarray::{Array3, ArrayView2};

use super::{
    chance::Chance, face_modes::FaceModes, gaze::Gaze, phrases::smooth_step, upper_face::lids,
};
use crate::{
    Result,
    audio::{PROSODY_FPS, Prosody},
};

/// Number of the random stream that draws the blinks.
const STREAM: u64 = u64::MAX;
const CLOSE_S: f64 = 0.06;
const HOLD_S: (f64, f64) = (0.03, 0.1);
/// How long the fast part of opening takes, and how long all of it takes.
const OPEN_S: f64 = 0.12;
const REST_S: f64 = 0.3;
/// Share of the opening that runs over all of that time; the rest is done in the fast part.
const TAIL: f64 = 0.18;
/// The most by which one eye opens later than the other.
const APART_S: f64 = 0.02;
const DOUBLE_SHARE: f64 = 0.2;
/// The shortest time from the fast part of one blink's opening to the start of the next blink.
const BETWEEN_S: f64 = 0.1;
/// A blink moves to a pause or a large leap of the eyes within this time, and within this share of
/// the mean interval.
const REACH_S: f64 = 1.0;
const REACH_SHARE: f64 = 0.3;
/// Share of the blinks that move to a pause or leap within reach.
const PAUSE_SHARE: f64 = 0.7;
/// Columns of sad, afraid, angry and the intensity among the conditions.
const SAD: usize = 5;
const AFRAID: usize = 8;
const ANGRY: usize = 9;
const INTENSITY: usize = 15;
/// How much an emotion at intensity 1 changes the rate; our own choice.
const EMOTION_GAIN: f32 = 0.3;

/// How far a lid halfway between open and shut stands in front of the straight path, metres. The lid
/// slides over an eyeball of 12 mm radius, where a chord of 10 mm lies up to 1.1 mm below its arc.
const ARC: f32 = 1.1e-3;

/// One closing of both eyes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blink {
    /// When the lids begin to close, seconds.
    pub start_s: f64,
    /// How long they stay closed, seconds.
    pub hold_s: f64,
    /// How much later the right eye opens than the left one, seconds; below 0 the left one is later.
    pub right_later_s: f64,
}

impl Blink {
    /// When the fast part of opening ends, seconds. The lids are then still closed by about 12 %.
    pub fn end_s(&self) -> f64 {
        self.opens_s() + OPEN_S
    }

    fn opens_s(&self) -> f64 {
        self.start_s + CLOSE_S + self.hold_s
    }

    /// The frames in which the lids move, in a clip of `count` frames.
    pub(super) fn frames(&self, fps: f64, count: usize) -> Range<usize> {
        let first = (self.start_s * fps).floor().max(0.0) as usize;
        let rest_s = self.opens_s() + APART_S + REST_S;
        let end = ((rest_s * fps).ceil() as usize + 1).min(count);
        first.min(end)..end
    }

    /// How far the lids of the right or the left eye are closed, 0 to 1. Smooth, and faster on the way
    /// down than up.
    pub(super) fn closure(&self, time_s: f64, right: bool) -> f32 {
        let later_s = if right {
            self.right_later_s
        } else {
            -self.right_later_s
        };
        let opening_s = time_s - self.opens_s() - later_s.max(0.0);
        let open =
            (1.0 - TAIL) * smooth_step(opening_s / OPEN_S) + TAIL * smooth_step(opening_s / REST_S);
        let falling = smooth_step((time_s - self.start_s) / CLOSE_S);
        falling.min(1.0 - open) as f32
    }
}

/// Draws the blinks of a performance, in rising order. They never overlap.
///
/// `affect`: `[T, 16]` at `fps`, mixture and intensity. `per_minute` counts every closing, so that a
/// double blink counts twice. Rates near 60 come out a little lower, because blinks never overlap.
pub fn blinks(
    affect: ArrayView2<'_, f32>,
    fps: f64,
    prosody: &Prosody,
    per_minute: f32,
    seed: u64,
) -> Vec<Blink> {
    let mut blinks: Vec<Blink> = Vec::new();
    if per_minute <= 0.0 {
        return blinks;
    }
    let duration_s = affect.nrows() as f64 / fps;
    let mean_s = 60.0 * (1.0 + DOUBLE_SHARE) / f64::from(per_minute);
    let mut chance = Chance::new(seed, STREAM);
    let leaps = Gaze::draw(prosody, duration_s, seed).large_leaps();
    // The lids stay closed for at least one frame, so that a low frame rate still shows them closed.
    let least_hold_s = (1.0 / fps).clamp(HOLD_S.0, HOLD_S.1);
    let mut time_s = mean_s * chance.unit();
    while time_s < duration_s {
        let occasion_s = near_occasion(time_s, mean_s, prosody, &leaps, &mut chance);
        let count = if chance.unit() < DOUBLE_SHARE { 2 } else { 1 };
        for _ in 0..count {
            let after = blinks.last().map_or(0.0, |last| last.end_s() + BETWEEN_S);
            blinks.push(Blink {
                start_s: occasion_s.max(after),
                hold_s: chance.between(least_hold_s, HOLD_S.1),
                right_later_s: chance.between(-APART_S, APART_S),
            });
        }
        let frame = ((time_s * fps) as usize).min(affect.nrows() - 1);
        let interval_s = mean_s * (0.25 + 1.5 * chance.bell());
        time_s += interval_s / f64::from(urge(affect.row(frame).as_slice().unwrap_or(&[])));
    }
    blinks
}

/// Closes the lids further than the emotion already does: `c + w (1 − c)`. So the lids meet and never
/// pass each other. Nothing but lids moves. `moved`: `[T, 68, 3]`, canonical metres.
pub(super) fn close_lids(
    moved: &mut Array3<f32>,
    fps: f64,
    blinks: &[Blink],
    modes: &FaceModes,
) -> Result<()> {
    let eyes = lids(modes)?;
    let last = moved.dim().0;
    for blink in blinks {
        for t in blink.frames(fps, last) {
            let mut frame = moved.index_axis_mut(ndarray::Axis(0), t);
            for (eye, right) in eyes.iter().zip([true, false]) {
                let weight = blink.closure(t as f64 / fps, right);
                let way = (1.0 - eye.closure(&frame)).max(0.0);
                eye.close(&mut frame, weight * way);
                // The height of an arc over its chord grows with the square of the chord.
                let arc = ARC * way * way;
                eye.bring_forward(&mut frame, arc * 4.0 * weight * (1.0 - weight));
            }
        }
    }
    Ok(())
}

/// Mostly the start of a pause near `time_s`, or else a large leap of the eyes near it. Otherwise
/// `time_s`.
fn near_occasion(
    time_s: f64,
    mean_s: f64,
    prosody: &Prosody,
    leaps: &[f64],
    chance: &mut Chance,
) -> f64 {
    let (move_it, delay_s) = (chance.unit() < PAUSE_SHARE, chance.between(0.0, 0.15));
    let reach_s = REACH_S.min(REACH_SHARE * mean_s);
    let pauses = prosody.pauses.iter();
    let begins: Vec<f64> = pauses
        .map(|p| p.start as f64 / PROSODY_FPS + delay_s)
        .collect();
    let nearest = |occasions: &[f64]| {
        let near = occasions.iter().copied();
        near.filter(|s| (s - time_s).abs() <= reach_s)
            .min_by(|a, b| (a - time_s).abs().total_cmp(&(b - time_s).abs()))
    };
    let occasion = nearest(&begins).or_else(|| nearest(leaps));
    occasion.filter(|_| move_it).unwrap_or(time_s)
}

/// Factor on the blink rate under an emotion, `[16]`.
fn urge(affect: &[f32]) -> f32 {
    match affect {
        [] => 1.0,
        _ => {
            let change = affect[SAD] + affect[ANGRY] - affect[AFRAID];
            (1.0 + EMOTION_GAIN * change * affect[INTENSITY]).max(0.4)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        audio::Waveform,
        conditions::{Emotion, EmotionCurve},
    };

    const MINUTES: f64 = 10.0;

    fn affect(emotion: &str) -> ndarray::Array2<f32> {
        let curve = EmotionCurve::Constant(Emotion::parse(emotion).unwrap());
        curve.sample((MINUTES * 60.0 * 30.0) as usize, 30.0)
    }

    /// A voice that pauses for half a second every three seconds.
    fn pausing() -> Prosody {
        let mut prosody = Prosody::of(&Waveform {
            samples: vec![0.0; 16_000],
        });
        let pauses = (0..(MINUTES * 20.0) as usize).map(|k| 300 * k + 250..300 * k + 300);
        prosody.pauses = pauses.collect();
        prosody
    }

    fn drawn(emotion: &str, per_minute: f32, seed: u64) -> Vec<Blink> {
        blinks(affect(emotion).view(), 30.0, &pausing(), per_minute, seed)
    }

    #[test]
    fn ten_minutes_have_the_asked_rate_within_a_fifth() {
        for (rate, tolerance) in [(5.0, 0.35), (15.0, 0.2), (30.0, 0.2), (60.0, 0.2)] {
            let count = drawn("neutral:0", rate, 3).len() as f64 / MINUTES;
            let error = (count / f64::from(rate) - 1.0).abs();
            assert!(error < tolerance, "{count} for {rate} a minute");
        }
        assert!(drawn("neutral:0", 0.0, 3).is_empty());
    }

    #[test]
    fn blinks_are_brief_mostly_single_and_apart() {
        let blinks = drawn("neutral:0", 15.0, 8);
        for pair in blinks.windows(2) {
            assert!(pair[1].start_s >= pair[0].end_s() + BETWEEN_S - 1e-9);
        }
        for blink in &blinks {
            assert!((0.21..0.29).contains(&(blink.end_s() - blink.start_s)));
        }
        let double = blinks
            .windows(2)
            .filter(|pair| pair[1].start_s - pair[0].end_s() < 0.12)
            .count() as f64;
        let share = double / (blinks.len() as f64 - double);
        assert!((0.08..0.33).contains(&share), "{share} double");
        let longest = blinks
            .windows(2)
            .map(|p| p[1].start_s - p[0].start_s)
            .fold(0.0, f64::max);
        assert!(longest < 11.0, "{longest} s without a blink");
    }

    #[test]
    fn blinks_prefer_pauses() {
        let blinks = drawn("neutral:0", 15.0, 1);
        let paused = blinks.iter().filter(|b| b.start_s % 3.0 >= 2.5).count() as f64;
        assert!(
            paused / blinks.len() as f64 > 0.35,
            "chance alone gives a sixth"
        );
    }

    #[test]
    fn the_sad_and_angry_blink_more_often_than_the_afraid() {
        let count = |emotion| drawn(emotion, 15.0, 4).len();
        assert!(count("sad:1") > count("afraid:1") + 20);
        assert!(count("angry:1") > count("afraid:1") + 20);
    }

    #[test]
    fn lids_open_more_slowly_than_they_close_and_not_quite_together() {
        let blink = Blink {
            start_s: 1.0,
            hold_s: 0.03,
            right_later_s: 0.02,
        };
        let closed = |time_s| blink.closure(time_s, true);
        assert_eq!((closed(1.0), closed(1.07), closed(1.5)), (0.0, 1.0, 0.0));
        // Tracked closure 40, 80, 120 and 200 ms after the lids begin to open: 0.81, 0.39, 0.23, 0.12.
        let tracked = [(0.04, 0.81), (0.08, 0.39), (0.12, 0.2), (0.2, 0.1)];
        for (after_s, value) in tracked {
            let closure = closed(blink.opens_s() + 0.02 + after_s);
            assert!((closure - value).abs() < 0.1, "{after_s} s: {closure}");
        }
        let left = blink.closure(blink.opens_s() + 0.06, false);
        assert!(left < closed(blink.opens_s() + 0.06) - 0.05);
    }

    #[test]
    fn large_leaps_of_the_eyes_are_blinked_over() {
        let mut prosody = pausing();
        prosody.pauses.clear();
        let affect = affect("neutral:0");
        let (mut met, mut all) = (0, 0);
        for seed in 0..8 {
            let leaps = Gaze::draw(&prosody, MINUTES * 60.0, seed).large_leaps();
            for blink in blinks(affect.view(), 30.0, &prosody, 15.0, seed) {
                met += i32::from(leaps.iter().any(|s| (s - blink.start_s).abs() < 0.01));
                all += 1;
            }
        }
        let share = f64::from(met) / f64::from(all);
        assert!((0.05..0.6).contains(&share), "{share} of the blinks");
    }

    #[test]
    fn another_seed_blinks_at_other_times() {
        assert_eq!(drawn("neutral:0", 15.0, 1), drawn("neutral:0", 15.0, 1));
        assert_ne!(drawn("neutral:0", 15.0, 1), drawn("neutral:0", 15.0, 2));
    }

    #[test]
    fn every_blink_closes_the_eyes_at_25_frames_a_second() {
        let modes = FaceModes::open(None).unwrap();
        let mut moved = Array3::zeros((1500, 68, 3));
        let affect = EmotionCurve::default().sample(1500, 25.0);
        let blinks = blinks(affect.view(), 25.0, &pausing(), 20.0, 6);
        close_lids(&mut moved, 25.0, &blinks, &modes).unwrap();
        let eyes = lids(&modes).unwrap();
        for blink in &blinks {
            let frames = (blink.start_s * 25.0) as usize..=(blink.end_s() * 25.0) as usize;
            for eye in &eyes {
                let closures = frames
                    .clone()
                    .filter(|t| *t < 1500)
                    .map(|t| eye.closure(&moved.index_axis(ndarray::Axis(0), t)));
                let most = closures.fold(0.0, f32::max);
                assert!(most > 0.999 || blink.end_s() > 60.0, "{blink:?}: {most}");
            }
        }
    }
}
