//! Rotation of the head of somebody who speaks.
//!
//! Nods go with syllables, the stressed ones most (Hadar et al. 1983; Graf et al. 2002); the head rises
//! before a phrase and sinks after it; posture changes from phrase to phrase, and over all lies a slow
//! drift. Sizes are those of the tracked head of grid_s1 within clips of 3 s: standard deviations
//! (medians) 0.65°, 0.38° and 0.20° of pitch, yaw and roll, mean speeds 5, 2.6 and 1.5 degrees a second
//! while he speaks, half as much in pauses; pitch has a third of its power above 2 Hz, yaw an eighth.

use super::{
    brow_accents::prominences,
    chance::Chance,
    phrases::{Phrases, smooth_step},
    slow_noise::SlowNoise,
};
use crate::audio::Prosody;

/// Number of this process among the streams of a seed.
const STREAM: u64 = u64::MAX - 2;
/// Deviation of the drift about x, y and z, degrees, while somebody speaks.
const DRIFT_DEG: [f64; 3] = [0.45, 0.48, 0.25];
const DRIFT_HZ: (f64, f64) = (0.1, 0.8);
/// Share of the drift that stays in pauses.
const DRIFT_AT_REST: f64 = 0.5;
/// How far the posture of one phrase may lie from rest, degrees.
const POSTURE_DEG: [f64; 3] = [0.6, 1.1, 0.5];
/// How long a change of posture takes, seconds.
const POSTURE_S: f64 = 0.9;
/// The head stands this much lower in pauses than in phrases, degrees.
const SINK_DEG: f64 = 0.8;
/// How far a nod goes on any syllable, and more of it for each deviation of prominence, degrees.
const NOD_DEG: f64 = 0.85;
const STRESS_DEG: f64 = 0.72;
const MOST_NOD_DEG: f64 = 2.4;
/// The head rises before it nods: share, and time before the nod, seconds.
const PREPARE: f64 = 0.5;
const PREPARE_S: f64 = 0.2;
/// Deviation of the bell of a nod, seconds, and how late it is on average.
const NOD_S: f64 = 0.07;
const LATE_S: f64 = 0.03;
/// Beyond this time nothing is left of a nod, seconds.
const NOD_REACH_S: f64 = 0.6;
/// Share of a nod that goes sideways, at most, about y and z.
const SIDEWAYS: [f64; 2] = [0.6, 0.4];
/// Farther no rotation goes about x, y and z at strength 1, degrees: the reach of a clip in 20.
const MOST_DEG: [f64; 3] = [3.0, 2.6, 1.5];
/// The head rises with the breath before a phrase by this much, degrees, and so long before it.
const BREATH_DEG: f64 = 0.45;
const BREATH_S: f64 = 0.15;
const BREATH_WIDTH_S: f64 = 0.22;
/// Shorter pauses bring no breath, seconds.
const BREATH_PAUSE_S: f64 = 0.35;

/// A nod on one syllable.
struct Nod {
    time_s: f64,
    /// About x, y and z, degrees.
    size: [f64; 3],
}

/// Rotation of the head over time, drawn once for a performance.
pub(super) struct HeadMotion {
    drift: [SlowNoise; 3],
    nods: Vec<Nod>,
    phrases: Phrases,
    /// One for each phrase, degrees.
    postures: Vec<[f64; 3]>,
}

impl HeadMotion {
    /// Same seed and sound, same motion.
    pub(super) fn draw(prosody: &Prosody, seed: u64) -> Self {
        let mut chance = Chance::new(seed, STREAM);
        let drift = std::array::from_fn(|_| SlowNoise::new(&mut chance, DRIFT_HZ.0, DRIFT_HZ.1));
        let phrases = Phrases::of(prosody);
        let posture = |_| POSTURE_DEG.map(|most| chance.between(-most, most));
        let postures = phrases.0.iter().map(posture).collect();
        HeadMotion {
            drift,
            nods: nods(prosody, &mut chance),
            phrases,
            postures,
        }
    }

    /// Rotation vector at `time_s` in radians, canonical axes; `breath` scales the rise before a phrase.
    pub(super) fn at(&self, time_s: f64, breath: f64) -> [f64; 3] {
        let activity = self.phrases.activity(time_s);
        let calm = DRIFT_AT_REST + (1.0 - DRIFT_AT_REST) * activity;
        let mut turn: [f64; 3] =
            std::array::from_fn(|i| calm * DRIFT_DEG[i] * self.drift[i].at(time_s));
        turn[0] += SINK_DEG * (0.5 - activity) - breath * self.breath(time_s);
        let posture = self.posture(time_s);
        for nod in self.near(time_s) {
            let share = nod.shape(time_s);
            (0..3).for_each(|i| turn[i] += share * nod.size[i]);
        }
        std::array::from_fn(|i| {
            let plain = turn[i] + posture[i];
            (MOST_DEG[i] * (plain / MOST_DEG[i]).tanh()).to_radians()
        })
    }

    fn near(&self, time_s: f64) -> impl Iterator<Item = &Nod> {
        let from = self
            .nods
            .partition_point(|nod| nod.time_s < time_s - NOD_REACH_S);
        let until = move |nod: &&Nod| nod.time_s < time_s + NOD_REACH_S;
        self.nods[from..].iter().take_while(until)
    }

    /// Goes over from one phrase's posture to the next one's while that begins.
    fn posture(&self, time_s: f64) -> [f64; 3] {
        let phrases = &self.phrases.0;
        let begun = |phrase: &super::phrases::Phrase| phrase.start_s - 0.5 * POSTURE_S <= time_s;
        let count = phrases.partition_point(begun);
        let of = |k: usize| match k {
            0 => [0.0; 3],
            k => self.postures[k - 1],
        };
        if count == 0 {
            return of(0);
        }
        let since = time_s - phrases[count - 1].start_s + 0.5 * POSTURE_S;
        let share = smooth_step(since / POSTURE_S);
        let (from, to) = (of(count - 1), of(count));
        std::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
    }

    /// How far the head has risen with the breath, degrees.
    fn breath(&self, time_s: f64) -> f64 {
        let phrases = &self.phrases.0;
        let next = phrases.partition_point(|phrase| phrase.end_s < time_s);
        let near = phrases[next.saturating_sub(1)..].iter().take(2);
        near.filter(|phrase| phrase.pause_s >= BREATH_PAUSE_S)
            .map(|phrase| BREATH_DEG * bell((time_s - phrase.start_s + BREATH_S) / BREATH_WIDTH_S))
            .sum()
    }
}

impl Nod {
    /// Up before the syllable, down on it.
    fn shape(&self, time_s: f64) -> f64 {
        let since_s = time_s - self.time_s;
        bell(since_s / NOD_S) - PREPARE * bell((since_s + PREPARE_S) / (1.3 * NOD_S))
    }
}

fn bell(x: f64) -> f64 {
    (-0.5 * x * x).exp()
}

fn nods(prosody: &Prosody, chance: &mut Chance) -> Vec<Nod> {
    let nod = |(frame, prominence): (usize, f32)| {
        // Drawn for every syllable, so that one syllable more does not shift what others get.
        let (vary, late_s) = (chance.between(0.4, 1.6), chance.between(-0.03, 0.03));
        let sideways = SIDEWAYS.map(|most| chance.between(-most, most));
        let stress = f64::from(prominence).max(-0.5);
        let size = (vary * (NOD_DEG + STRESS_DEG * stress)).min(MOST_NOD_DEG);
        Nod {
            time_s: Prosody::time_s(frame) + LATE_S + late_s,
            size: [size, sideways[0] * size, sideways[1] * size],
        }
    };
    let mut nods: Vec<Nod> = prominences(prosody).into_iter().map(nod).collect();
    nods.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    nods
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::phrases::tests::speaking;

    const FPS: f64 = 25.0;

    /// Degrees, `seconds` at 25 frames a second.
    fn track(seed: u64, seconds: usize) -> Vec<[f64; 3]> {
        let motion = HeadMotion::draw(&speaking(seconds, 60), seed);
        let at = |t: usize| motion.at(t as f64 / FPS, 1.0).map(f64::to_degrees);
        (0..seconds * 25).map(at).collect()
    }

    fn deviation(track: &[[f64; 3]], axis: usize) -> f64 {
        let mean = track.iter().map(|r| r[axis]).sum::<f64>() / track.len() as f64;
        let power = track.iter().map(|r| (r[axis] - mean).powi(2)).sum::<f64>();
        (power / track.len() as f64).sqrt()
    }

    /// Mean, degrees a second.
    fn speed(track: &[[f64; 3]], axis: usize) -> f64 {
        let steps = track
            .windows(2)
            .map(|pair| (pair[1][axis] - pair[0][axis]).abs());
        FPS * steps.sum::<f64>() / (track.len() - 1) as f64
    }

    #[test]
    fn each_axis_moves_as_far_and_as_fast_as_the_tracked_head_within_three_seconds() {
        // 5th and 95th percentiles over the clips of grid_s1.
        let tracked = [(0.40, 1.13), (0.20, 0.95), (0.11, 0.55)];
        let speeds = [(3.5, 7.8), (1.5, 3.6), (0.8, 2.2)];
        let clips: Vec<_> = (0..40).map(|seed| track(seed, 3)).collect();
        for axis in 0..3 {
            let mut sd: Vec<f64> = clips.iter().map(|clip| deviation(clip, axis)).collect();
            sd.sort_by(f64::total_cmp);
            let (low, high) = tracked[axis];
            assert!(sd[4] > low && sd[35] < high, "axis {axis}: {sd:?}");
            let speed = clips.iter().map(|clip| speed(clip, axis)).sum::<f64>() / 40.0;
            let (low, high) = speeds[axis];
            assert!((low..high).contains(&speed), "axis {axis}: {speed}");
        }
    }

    #[test]
    fn no_rotation_leaves_what_a_clip_shows() {
        for seed in 0..5 {
            for turn in track(seed, 60) {
                for (x, most) in turn.iter().zip(MOST_DEG) {
                    assert!(x.abs() < most);
                }
            }
        }
    }

    #[test]
    fn stressed_syllables_are_nodded() {
        let prosody = speaking(60, 60);
        let motion = HeadMotion::draw(&prosody, 2);
        let (mut on, mut between, mut count) = (0.0, 0.0, 0.0);
        for (frame, prominence) in prominences(&prosody) {
            if prominence > 1.0 {
                let time_s = Prosody::time_s(frame) + LATE_S;
                on += motion.at(time_s, 0.0)[0].to_degrees();
                between += motion.at(time_s - 0.15, 0.0)[0].to_degrees();
                count += 1.0;
            }
        }
        assert!(
            (on - between) / count > 0.5,
            "{} down on a stress",
            (on - between) / count
        );
    }

    #[test]
    fn a_breath_lifts_the_head_before_a_phrase_and_nowhere_else() {
        let motion = HeadMotion::draw(&speaking(9, 60), 0);
        let lift =
            |time_s: f64| (motion.at(time_s, 0.0)[0] - motion.at(time_s, 1.0)[0]).to_degrees();
        assert!(lift(3.0 - BREATH_S) > 0.2);
        assert!(lift(1.5).abs() < 1e-3);
    }
}
