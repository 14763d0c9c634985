//! Where the eyes look while somebody speaks to a partner.
//!
//! The eyes rest on one point, leap to another and rest again. Most points lie on the partner's face:
//! its eyes and mouth, 3° apart at talking distance. Now and then the speaker looks away, more likely
//! at the start of a phrase, and comes back (Kendon 1967; Argyle & Cook 1976). A leap takes 21 ms plus
//! 2.2 ms for each degree (Carpenter 1988, as in Lee, Badler & Badler, Eyes Alive, 2002). During a
//! rest both eyes stay on the same point: they turn against the head when it moves. The tracked eyes
//! of grid_s1 leap 22 to 91 times a minute (median 43; leaps of at least 1.5°, half of them beyond
//! 3.3°).

use std::ops::Range;

use super::{
    chance::Chance,
    phrases::{Phrases, smooth_step},
};
use crate::audio::Prosody;

/// Number of the random stream that draws the gaze.
const STREAM: u64 = u64::MAX - 3;
/// Distance of the partner in a talk between two, metres (Hall 1966, 0.45 to 1.2 m and beyond).
const PARTNER_M: f64 = 1.2;
/// Centres of the eyeballs of the mean ICT face, the right one first, canonical metres.
pub(super) const EYES: [[f64; 3]; 2] = [[-0.032, 0.046, 0.071], [0.032, 0.046, 0.071]];
/// The partner's two eyes and mouth, in degrees to the left and up from the middle between the
/// speaker's eyes, and how often the speaker looks at each.
const FACE_DEG: [([f64; 2], f64); 3] = [([-1.5, 0.0], 0.4), ([1.5, 0.0], 0.4), ([0.0, -3.2], 0.2)];
/// How far the eyes land from these points at most, degrees along each axis.
const SCATTER_DEG: f64 = 0.5;
/// How long the eyes rest on the partner, and away from the partner: least and mean time, seconds.
const REST_S: (f64, f64) = (0.3, 1.2);
const AWAY_S: (f64, f64) = (0.3, 0.8);
/// Chance that a leap goes away from the partner, and that chance at the start of a phrase.
const AWAY: f64 = 0.12;
const AWAY_AT_START: f64 = 0.4;
/// A leap within this time of the first sound of a phrase counts as at its start, seconds.
const START_S: f64 = 0.4;
/// How far away from the partner the eyes look: least and greatest, degrees.
const AWAY_DEG: (f64, f64) = (5.0, 11.0);
/// How far eyes that avoid the partner look to the side and down, degrees. `OTHER_SIDE` is the share
/// of these rests on the less preferred side.
const AVERTED_DEG: [(f64, f64); 2] = [(4.0, 12.0), (5.0, 10.0)];
const OTHER_SIDE: f64 = 0.2;
/// Number of the random stream that draws the averted rests.
const AVERSION_STREAM: u64 = u64::MAX - 5;
/// Duration of a leap: a constant part, and a part for each degree, seconds.
const LEAP_S: f64 = 0.021;
const LEAP_S_PER_DEG: f64 = 0.0022;
/// A leap of at least this size invites a blink (Evinger et al. 1994), degrees.
pub(super) const LARGE_DEG: f64 = 5.0;

/// A point that the eyes leap to and rest on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fixation {
    /// When the leap begins, seconds.
    start_s: f64,
    /// Direction from the middle between the eyes: to the speaker's left and up, degrees.
    point_deg: [f64; 2],
    is_away: bool,
}

/// The points that the eyes rest on, drawn once for a performance.
pub(super) struct Gaze(Vec<Fixation>);

impl Gaze {
    /// The same seed and sound give the same points.
    pub(super) fn draw(prosody: &Prosody, duration_s: f64, seed: u64) -> Self {
        let phrases = Phrases::of(prosody);
        let mut chance = Chance::new(seed, STREAM);
        let mut fixations = vec![Fixation {
            start_s: 0.0,
            point_deg: scattered(FACE_DEG[0].0, &mut chance),
            is_away: false,
        }];
        let mut time_s = rest_s(REST_S, &mut chance);
        while time_s < duration_s {
            let before = fixations[fixations.len() - 1];
            let next = next(before, time_s, &phrases, &mut chance);
            time_s += rest_s(if next.is_away { AWAY_S } else { REST_S }, &mut chance);
            fixations.push(next);
        }
        Gaze(fixations)
    }

    /// Turns a share of the rests away from the partner, down and mostly to the side that the seed
    /// prefers. `aversion`: that share at a time in seconds.
    pub(super) fn avert(&mut self, aversion: impl Fn(f64) -> f64, seed: u64) {
        let mut chance = Chance::new(seed, AVERSION_STREAM);
        let side = if chance.unit() < 0.5 { -1.0 } else { 1.0 };
        for fixation in &mut self.0 {
            // Every rest draws, averted or not, so that a change of emotion moves no other rest.
            let (drawn, other) = (chance.unit(), chance.unit());
            let across = chance.between(AVERTED_DEG[0].0, AVERTED_DEG[0].1);
            let down = chance.between(AVERTED_DEG[1].0, AVERTED_DEG[1].1);
            if drawn < aversion(fixation.start_s) {
                let side = if other < OTHER_SIDE { -side } else { side };
                fixation.point_deg = [side * across, -down];
                fixation.is_away = true;
            }
        }
    }

    /// Yaw (to the speaker's left) and pitch (up) of the right and the left eye in the head, radians.
    /// `head`: rotation vector of the head, radians, about the middle between the jaw's hinges.
    pub(super) fn at(&self, time_s: f64, head: [f64; 3]) -> [[f64; 2]; 2] {
        let target = point(self.point_deg(time_s));
        EYES.map(|eye| {
            // In the frame of the head the partner turns the other way.
            let target_in_head = rotated(target, head.map(|x| -x));
            let to: [f64; 3] = std::array::from_fn(|i| target_in_head[i] - eye[i]);
            [to[0].atan2(to[2]), to[1].atan2(to[0].hypot(to[2]))]
        })
    }

    /// Start times of the large leaps, seconds, in rising order.
    pub(super) fn large_leaps(&self) -> Vec<f64> {
        let leaps = self.leaps().filter(|(_, size)| *size >= LARGE_DEG);
        leaps.map(|(stretch, _)| stretch.start).collect()
    }

    /// The time span of each leap and its size in degrees.
    fn leaps(&self) -> impl Iterator<Item = (Range<f64>, f64)> {
        self.0.windows(2).map(|pair| {
            let [from, to] = [pair[0], pair[1]].map(|fixation| fixation.point_deg);
            let size = (to[0] - from[0]).hypot(to[1] - from[1]);
            let start_s = pair[1].start_s;
            (start_s..start_s + leap_s(size), size)
        })
    }

    fn point_deg(&self, time_s: f64) -> [f64; 2] {
        let begun = self
            .0
            .partition_point(|fixation| fixation.start_s <= time_s);
        let to = self.0[begun.saturating_sub(1)];
        let Some(from) = begun.checked_sub(2).map(|k| self.0[k].point_deg) else {
            return to.point_deg;
        };
        let way = [to.point_deg[0] - from[0], to.point_deg[1] - from[1]];
        let share = smooth_step((time_s - to.start_s) / leap_s(way[0].hypot(way[1])));
        std::array::from_fn(|i| from[i] + share * way[i])
    }
}

fn leap_s(size_deg: f64) -> f64 {
    LEAP_S + LEAP_S_PER_DEG * size_deg
}

/// A random time of at least `least` and on average about `mean`. Long times are rare.
fn rest_s((least, mean): (f64, f64), chance: &mut Chance) -> f64 {
    let more = -(1.0 - chance.unit()).ln();
    least + (mean - least) * more.min(3.0)
}

fn next(before: Fixation, start_s: f64, phrases: &Phrases, chance: &mut Chance) -> Fixation {
    let starts = phrases.0.iter().map(|phrase| phrase.start_s);
    let begins = starts.into_iter().any(|s| (start_s - s).abs() < START_S);
    let (drawn, pick) = (chance.unit(), chance.unit());
    let (turn, size) = (chance.unit(), chance.between(AWAY_DEG.0, AWAY_DEG.1));
    let is_away = !before.is_away && drawn < if begins { AWAY_AT_START } else { AWAY };
    let point_deg = if is_away {
        beside(turn, size)
    } else {
        scattered(on_face(before.point_deg, pick), chance)
    };
    Fixation {
        start_s,
        point_deg,
        is_away,
    }
}

/// A point away from the partner, farther to the side than up or down.
fn beside(turn: f64, size: f64) -> [f64; 2] {
    let angle = std::f64::consts::TAU * turn;
    [size * angle.cos(), 0.6 * size * angle.sin()]
}

/// A point of the partner's face at which the eyes are not already looking.
fn on_face(now: [f64; 2], pick: f64) -> [f64; 2] {
    let far = |point: &[f64; 2]| (point[0] - now[0]).hypot(point[1] - now[1]) > 2.0;
    let free = || FACE_DEG.iter().filter(|(point, _)| far(point));
    let mut left = pick * free().map(|(_, often)| often).sum::<f64>();
    let mut chosen = FACE_DEG[0].0;
    for (point, often) in free() {
        chosen = *point;
        left -= often;
        if left < 0.0 {
            break;
        }
    }
    chosen
}

fn scattered(point: [f64; 2], chance: &mut Chance) -> [f64; 2] {
    point.map(|x| x + chance.between(-SCATTER_DEG, SCATTER_DEG))
}

/// The point in a direction from the middle between the eyes, at the partner's distance, canonical
/// metres.
fn point([left_deg, up_deg]: [f64; 2]) -> [f64; 3] {
    let [right, left] = EYES;
    let middle: [f64; 3] = std::array::from_fn(|i| 0.5 * (right[i] + left[i]));
    let (yaw, pitch) = (left_deg.to_radians(), up_deg.to_radians());
    let way = [
        yaw.sin() * pitch.cos(),
        pitch.sin(),
        yaw.cos() * pitch.cos(),
    ];
    std::array::from_fn(|i| middle[i] + PARTNER_M * way[i])
}

/// Rodrigues' rotation of a point by a rotation vector.
fn rotated(point: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    let angle = by.iter().map(|x| x * x).sum::<f64>().sqrt();
    if angle == 0.0 {
        return point;
    }
    let axis = by.map(|x| x / angle);
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let (once, along) = (
        cross(axis, point),
        axis.iter().zip(point).map(|(a, b)| a * b).sum::<f64>(),
    );
    let (sine, cosine) = angle.sin_cos();
    std::array::from_fn(|i| cosine * point[i] + sine * once[i] + (1.0 - cosine) * along * axis[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::phrases::tests::speaking;

    const STILL: [f64; 3] = [0.0; 3];

    fn drawn(seed: u64) -> Gaze {
        Gaze::draw(&speaking(600, 60), 600.0, seed)
    }

    #[test]
    fn the_eyes_leap_as_often_and_as_far_as_those_that_were_tracked() {
        for seed in 0..4 {
            let gaze = drawn(seed);
            let mut sizes: Vec<f64> = gaze.leaps().map(|(_, size)| size).collect();
            sizes.sort_by(f64::total_cmp);
            let rate = sizes.iter().filter(|size| **size >= 1.5).count() as f64 / 10.0;
            assert!((22.0..91.0).contains(&rate), "{rate} a minute");
            let median = sizes[sizes.len() / 2];
            assert!((2.0..5.0).contains(&median), "{median} degrees");
            assert!(sizes[sizes.len() - 1] < 20.0);
        }
    }

    #[test]
    fn a_leap_takes_a_frame_and_between_leaps_the_eyes_rest() {
        let gaze = drawn(1);
        for (stretch, size) in gaze.leaps() {
            assert!(
                (0.02..0.07).contains(&(stretch.end - stretch.start)),
                "{size}"
            );
            let after = [0.001, 0.1, 0.2].map(|wait| gaze.at(stretch.end + wait, STILL));
            assert!(after[0] == after[1] && after[1] == after[2]);
        }
    }

    #[test]
    fn both_eyes_meet_at_the_partner() {
        let [right, left] = drawn(0).at(0.0, STILL);
        let meet = 2.0 * (0.032f64 / PARTNER_M).atan();
        assert!((right[0] - left[0] - meet).abs() < 0.1 * meet);
        assert_eq!(right[1].signum(), left[1].signum());
    }

    #[test]
    fn the_eyes_stay_on_their_point_when_the_head_turns() {
        let gaze = drawn(0);
        let straight = gaze.at(0.0, STILL)[0];
        let nodded = gaze.at(0.0, [0.02, 0.0, 0.0])[0];
        let turned = gaze.at(0.0, [0.0, 0.02, 0.0])[0];
        // When the head nods down, the eyes turn up. When it turns left, they turn right.
        assert!((0.015..0.025).contains(&(nodded[1] - straight[1])));
        assert!((-0.025..-0.015).contains(&(turned[0] - straight[0])));
    }

    #[test]
    fn looking_away_is_the_lesser_part_and_rather_where_a_phrase_begins() {
        let gaze = drawn(3);
        let ends = gaze
            .0
            .windows(2)
            .map(|pair| pair[1].start_s - pair[0].start_s);
        let away_s: f64 = gaze
            .0
            .iter()
            .zip(ends)
            .filter(|(fixation, _)| fixation.is_away)
            .map(|(_, rest_s)| rest_s)
            .sum();
        assert!(
            (0.02..0.25).contains(&(away_s / 600.0)),
            "{away_s} s of 600"
        );
        let away = gaze.0.iter().filter(|fixation| fixation.is_away);
        let (near, all) = away.fold((0, 0), |(near, all), fixation| {
            let phase = (fixation.start_s + START_S) % 3.0;
            (near + i32::from(phase < 2.0 * START_S), all + 1)
        });
        assert!(f64::from(near) / f64::from(all) > 0.35, "{near} of {all}");
    }
}
