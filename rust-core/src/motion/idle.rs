//! Blinks, eye movements and head drift for live speech, where the sound ahead is unknown.
//!
//! [`super::blinks`], [`super::gaze`] and [`super::head`] see the whole sound and follow its
//! pauses. The motion here looks at nothing ahead. Its sizes and rates are similar to theirs. The
//! same seed gives the same motion.

use super::{blinks::Blink, chance::Chance, phrases::smooth_step, slow_noise::SlowNoise};

/// The number of the random stream that this process draws from.
const STREAM: u64 = u64::MAX - 9;
/// Mean time between two blinks, seconds. Each lies between a quarter and seven quarters of it.
const BLINK_S: f64 = 3.5;
const HOLD_S: (f64, f64) = (0.03, 0.1);
const APART_S: f64 = 0.02;
/// How long the eyes rest on a point, seconds.
const REST_S: (f64, f64) = (0.4, 2.2);
/// How far such a point may lie from the middle, sideways and in height, degrees.
const BESIDE_DEG: [f64; 2] = [4.0, 2.0];
/// How long the eyes take to leap to the next point, seconds.
const LEAP_S: f64 = 0.03;
/// Standard deviation of the head's drift about x, y and z, degrees.
const DRIFT_DEG: [f64; 3] = [0.8, 0.9, 0.45];
const DRIFT_HZ: (f64, f64) = (0.1, 0.8);
/// Share of the drift that stays in pauses.
const DRIFT_AT_REST: f64 = 0.5;

/// The face at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Idle {
    /// How far the right and the left eye are closed, 0 to 1.
    pub closed: [f32; 2],
    /// Where both eyes look, to the subject's left and up, degrees.
    pub look_deg: [f64; 2],
    /// Rotation vector of the head, radians.
    pub head: [f32; 3],
}

/// The process behind this motion. Each call has to be for a later time.
pub struct IdleMotion {
    chance: Chance,
    drift: [SlowNoise; 3],
    blink: Blink,
    next_blink: Blink,
    /// When the last leap of the eyes began.
    leap_s: f64,
    /// Where that leap started and where it ended.
    points_deg: [[f64; 2]; 2],
    next_leap_s: f64,
    /// How much the mouth has been open lately, 0 to 1.
    speaking: f64,
    /// Mean time between two blinks, seconds; infinite without blinks.
    blink_s: f64,
}

impl IdleMotion {
    /// Starts at the beginning of a performance.
    pub fn new(seed: u64) -> IdleMotion {
        let mut chance = Chance::new(seed, STREAM);
        let drift = [(); 3].map(|()| SlowNoise::new(&mut chance, DRIFT_HZ.0, DRIFT_HZ.1));
        let first = blink_after(0.0, BLINK_S, &mut chance);
        let next_blink = blink_after(first.end_s(), BLINK_S, &mut chance);
        IdleMotion {
            next_leap_s: chance.between(REST_S.0, REST_S.1),
            chance,
            drift,
            blink: first,
            next_blink,
            leap_s: 0.0,
            points_deg: [[0.0; 2]; 2],
            speaking: 0.0,
            blink_s: BLINK_S,
        }
    }

    /// Sets how often the eyes blink in `share`s of the usual rate; 0 for never.
    pub fn set_blinks(&mut self, share: f64) {
        let blink_s = BLINK_S / share;
        if blink_s != self.blink_s {
            self.blink_s = blink_s;
            self.next_blink = blink_after(self.blink.end_s(), blink_s, &mut self.chance);
        }
    }

    /// The face at `time_s`, which must be later than in all calls before. `opening`: how far the
    /// mouth is open, 0 to 1.
    pub fn at(&mut self, time_s: f64, opening: f64) -> Idle {
        while time_s >= self.next_blink.start_s {
            self.blink = self.next_blink;
            self.next_blink = blink_after(self.blink.end_s(), self.blink_s, &mut self.chance);
        }
        while time_s >= self.next_leap_s {
            self.leap_s = self.next_leap_s;
            let to = BESIDE_DEG.map(|most| self.chance.between(-most, most));
            self.points_deg = [self.points_deg[1], to];
            self.next_leap_s += self.chance.between(REST_S.0, REST_S.1);
        }
        self.speaking += 0.05 * ((8.0 * opening).min(1.0) - self.speaking);
        let share = smooth_step((time_s - self.leap_s) / LEAP_S);
        let [from, to] = self.points_deg;
        let size = DRIFT_AT_REST + (1.0 - DRIFT_AT_REST) * self.speaking;
        let turn =
            |axis: usize| (size * DRIFT_DEG[axis] * self.drift[axis].at(time_s)).to_radians();
        Idle {
            closed: [true, false].map(|right| {
                if self.blink_s.is_finite() {
                    self.blink.closure(time_s, right)
                } else {
                    0.0
                }
            }),
            look_deg: [0, 1].map(|i| from[i] + share * (to[i] - from[i])),
            head: [0, 1, 2].map(|axis| turn(axis) as f32),
        }
    }
}

fn blink_after(end_s: f64, mean_s: f64, chance: &mut Chance) -> Blink {
    Blink {
        start_s: end_s + mean_s * (0.25 + 1.5 * chance.bell()),
        hold_s: chance.between(HOLD_S.0, HOLD_S.1),
        right_later_s: chance.between(-APART_S, APART_S),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_blinks_some_fifteen_times_a_minute_and_stays_small() {
        let mut idle = IdleMotion::new(0);
        let frames: Vec<Idle> = (0..15_000)
            .map(|t| idle.at(f64::from(t) / 25.0, 0.0))
            .collect();
        let shut = |idle: &Idle| idle.closed[0] > 0.5;
        let blinks = frames
            .windows(2)
            .filter(|w| !shut(&w[0]) && shut(&w[1]))
            .count();
        assert!((100..220).contains(&blinks), "{blinks} in ten minutes");
        let mut still = IdleMotion::new(0);
        still.set_blinks(0.0);
        assert!((0..15_000).all(|t| still.at(f64::from(t) / 25.0, 0.0).closed == [0.0; 2]));
        for frame in &frames {
            assert!(frame.head.iter().all(|x| x.abs() < 0.04), "{frame:?}");
            assert!(frame.look_deg[0].abs() <= BESIDE_DEG[0], "{frame:?}");
        }
    }
}
