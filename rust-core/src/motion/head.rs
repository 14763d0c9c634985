//! Rotation of the head during speech.
//!
//! The head nods on syllables, most on stressed ones (Hadar et al. 1983; Graf et al. 2002). It
//! rises before a phrase and sinks after it, and its posture changes from phrase to phrase. A slow
//! drift is added to all of this. The sizes come from the tracked head of grid_s1 in clips of 3 s.
//! Its pitch, yaw and roll have standard deviations (medians) of 0.65°, 0.38° and 0.20°. Their
//! mean speeds are 5, 2.6 and 1.5 degrees a second while he speaks, and half of that in pauses.
//! Pitch has a third of its power above 2 Hz, yaw an eighth.
//!
//! This speaker reads calmly. A voice whose pitch moves more, or an emotion, makes the head
//! livelier: it nods by 4 to 8° in about half a second on strongly stressed syllables, and drift
//! and posture grow. [`Mood`] describes the effect of an emotion.

use super::{
    brow_accents::prominences, chance::Chance, liveliness::liveliness, mood::Mood,
    phrases::Phrases, slow_noise::SlowNoise,
};
use crate::audio::Prosody;

/// The number of the random stream that this process draws from.
const STREAM: u64 = u64::MAX - 2;
/// Standard deviation of the drift about x, y and z during speech, degrees.
const DRIFT_DEG: [f64; 3] = [0.45, 0.48, 0.25];
const DRIFT_HZ: (f64, f64) = (0.1, 0.8);
/// Share of the drift that stays in pauses.
const DRIFT_AT_REST: f64 = 0.5;
/// The most that the posture of a phrase may differ from rest about x, y and z, degrees.
const POSTURE_DEG: [f64; 3] = [0.6, 1.1, 0.5];
/// How long a change of posture takes, seconds.
const POSTURE_S: f64 = 0.9;
/// The head stands this much lower in pauses than in phrases, degrees.
const SINK_DEG: f64 = 0.8;
/// Size of a nod on a syllable of average prominence, degrees.
const NOD_DEG: f64 = 0.85;
/// What each standard deviation of prominence adds to a nod, degrees.
const STRESS_DEG: f64 = 0.72;
const MAX_NOD_DEG: f64 = 2.4;
/// The head rises before a nod by this share of it.
const PREPARE: f64 = 0.5;
/// How long before the nod the head rises, seconds.
const PREPARE_S: f64 = 0.2;
/// Standard deviation of the bell curve of a nod, seconds.
const NOD_S: f64 = 0.07;
/// How long after the syllable a nod comes on average, seconds.
const LATE_S: f64 = 0.03;
/// A nod has no effect farther away than this, seconds.
const NOD_REACH_S: f64 = 1.2;
/// The prominence, in standard deviations, from which a lively head makes a far nod.
const STRONG: f64 = 0.9;
/// Size of the bell curve of a far nod at that prominence, degrees.
const FAR_DEG: f64 = 3.6;
/// What each further standard deviation of prominence adds, degrees.
const FARTHER_DEG: f64 = 0.6;
const FARTHEST_DEG: f64 = 4.4;
/// Standard deviation of the bell curve of a far nod, seconds.
const FAR_S: f64 = 0.1;
/// The head rises before a far nod by this share of it.
const FAR_PREPARE: f64 = 0.2;
/// How long before the far nod the head rises, seconds.
const FAR_PREPARE_S: f64 = 0.3;
/// Shortest time between two far nods, seconds.
const FAR_APART_S: f64 = 0.9;
/// Share of the suitable syllables that get a far nod.
const FAR_SHARE: f64 = 0.8;
/// How much a liveliness of 1 adds to drift and posture.
const LIVELY_DRIFT: f64 = 0.8;
/// The highest liveliness.
const MAX_LIVELY: f64 = 1.2;
/// The largest shares of a nod that turn about y and z.
const SIDEWAYS: [f64; 2] = [0.6, 0.4];
/// The largest rotation about x, y and z at strength 1, degrees. One clip in 20 reaches this far.
const MAX_DEG: [f64; 3] = [3.0, 2.6, 1.5];
/// How much a liveliness of 1 adds to the largest rotation, degrees.
const LIVELY_MOST_DEG: [f64; 3] = [9.0, 5.0, 3.0];
/// How far the head rises with the breath before a phrase, degrees.
const BREATH_DEG: f64 = 0.45;
/// How long before the phrase it has risen that far, seconds.
const BREATH_S: f64 = 0.15;
const BREATH_WIDTH_S: f64 = 0.22;
/// Shortest pause with a breath at its end, seconds.
const BREATH_PAUSE_S: f64 = 0.35;

/// A nod on one syllable.
struct Nod {
    time_s: f64,
    /// About x, y and z, degrees.
    size: [f64; 3],
    /// How much a liveliness of 1 adds to `size`.
    far: [f64; 3],
}

/// Rotation of the head over time, drawn once for a performance.
pub(super) struct HeadMotion {
    liveliness: f64,
    drift: [SlowNoise; 3],
    nods: Vec<Nod>,
    phrases: Phrases,
    /// For each axis, one angle per phrase, degrees.
    postures: [Vec<f64>; 3],
}

impl HeadMotion {
    /// Draws the motion. The same seed and sound give the same motion.
    pub(super) fn draw(prosody: &Prosody, seed: u64) -> Self {
        let mut chance = Chance::new(seed, STREAM);
        let drift = std::array::from_fn(|_| SlowNoise::new(&mut chance, DRIFT_HZ.0, DRIFT_HZ.1));
        let phrases = Phrases::of(prosody);
        let count = phrases.0.len();
        let postures =
            POSTURE_DEG.map(|most| (0..count).map(|_| chance.between(-most, most)).collect());
        HeadMotion {
            liveliness: liveliness(prosody),
            drift,
            nods: nods(prosody, &mut chance),
            phrases,
            postures,
        }
    }

    /// The rotation vector at `time_s` in radians, canonical axes. `breath` scales the rise before
    /// a phrase. `drift_s` is the time of the drift, which runs at the pace of the moods.
    pub(super) fn at(&self, time_s: f64, drift_s: f64, breath: f64, mood: &Mood) -> [f64; 3] {
        let lively = (self.liveliness + mood.liveliness).clamp(0.0, MAX_LIVELY);
        let size = mood.size * (1.0 + LIVELY_DRIFT * lively);
        let activity = self.phrases.activity(time_s);
        let calm = DRIFT_AT_REST + (1.0 - DRIFT_AT_REST) * activity;
        let posture = self.posture(time_s);
        let mut turn: [f64; 3] = std::array::from_fn(|i| {
            size * (calm * DRIFT_DEG[i] * self.drift[i].at(drift_s) + posture[i])
        });
        turn[0] += mood.size * SINK_DEG * (0.5 - activity) - breath * self.breath(time_s);
        for nod in self.near(time_s) {
            // A nod is never quicker than in calm speech. Larger nods would jerk otherwise.
            let since_s = mood.pace.min(1.0) * (time_s - nod.time_s);
            let share = mood.size * mood.pace.sqrt() * nod_shape(since_s);
            let far = lively * far_nod_shape(since_s);
            (0..3).for_each(|i| turn[i] += share * nod.size[i] + far * nod.far[i]);
        }
        turn = std::array::from_fn(|i| {
            let most = mood.size.max(1.0) * MAX_DEG[i] + lively * LIVELY_MOST_DEG[i];
            most * (turn[i] / most).tanh()
        });
        turn[0] += mood.down_deg;
        turn.map(f64::to_radians)
    }

    fn near(&self, time_s: f64) -> impl Iterator<Item = &Nod> {
        let from = self
            .nods
            .partition_point(|nod| nod.time_s < time_s - NOD_REACH_S);
        let until = move |nod: &&Nod| nod.time_s < time_s + NOD_REACH_S;
        self.nods[from..].iter().take_while(until)
    }

    fn posture(&self, time_s: f64) -> [f64; 3] {
        self.postures
            .each_ref()
            .map(|postures| self.phrases.between(postures, 0.0, POSTURE_S, time_s))
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

/// The course of a nod: up before the syllable, down on it.
fn nod_shape(since_s: f64) -> f64 {
    bell(since_s / NOD_S) - PREPARE * bell((since_s + PREPARE_S) / (1.3 * NOD_S))
}

/// The course of a far nod, which is slower.
fn far_nod_shape(since_s: f64) -> f64 {
    bell(since_s / FAR_S) - FAR_PREPARE * bell((since_s + FAR_PREPARE_S) / (1.3 * FAR_S))
}

fn bell(x: f64) -> f64 {
    (-0.5 * x * x).exp()
}

fn nods(prosody: &Prosody, chance: &mut Chance) -> Vec<Nod> {
    let mut free_s = f64::NEG_INFINITY;
    let nod = |(frame, prominence): (usize, f32)| {
        // Draw all numbers for every syllable, so that a far nod more or less does not shift the
        // numbers of the syllables after it.
        let (vary, late_s) = (chance.between(0.4, 1.6), chance.between(-0.03, 0.03));
        let sideways = SIDEWAYS.map(|most| chance.between(-most, most));
        let (pick, more_deg) = (chance.unit(), chance.between(-0.4, 0.4));
        let prominence = f64::from(prominence);
        let size = (vary * (NOD_DEG + STRESS_DEG * prominence.max(-0.5))).min(MAX_NOD_DEG);
        let time_s = Prosody::time_s(frame) + LATE_S + late_s;
        let is_far = prominence >= STRONG && time_s >= free_s && pick < FAR_SHARE;
        let far = if is_far {
            (FAR_DEG + FARTHER_DEG * (prominence - STRONG) + more_deg).min(FARTHEST_DEG)
        } else {
            0.0
        };
        if is_far {
            free_s = time_s + FAR_APART_S;
        }
        Nod {
            time_s,
            size: [size, sideways[0] * size, sideways[1] * size],
            far: [far, sideways[0] * far, sideways[1] * far],
        }
    };
    let mut nods: Vec<Nod> = prominences(prosody).into_iter().map(nod).collect();
    nods.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    nods
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        conditions::{Emotion, EmotionCurve},
        motion::{mood::moods, phrases::tests::speaking},
    };

    const FPS: f64 = 25.0;

    /// The rotations of `seconds` of speech at 25 frames a second, degrees.
    fn track(seed: u64, seconds: usize) -> Vec<[f64; 3]> {
        let motion = HeadMotion::draw(&speaking(seconds, 60), seed);
        let at = |t: usize| at(&motion, t as f64 / FPS, 1.0).map(f64::to_degrees);
        (0..seconds * 25).map(at).collect()
    }

    fn at(motion: &HeadMotion, time_s: f64, breath: f64) -> [f64; 3] {
        motion.at(time_s, time_s, breath, &Mood::NEUTRAL)
    }

    /// The rotations of a minute of `prosody`, degrees.
    fn in_mood(prosody: &Prosody, emotion: &str) -> Vec<[f64; 3]> {
        let curve = EmotionCurve::Constant(Emotion::parse(emotion).unwrap());
        let mood = moods(curve.sample(1, FPS).view(), FPS)[0];
        let motion = HeadMotion::draw(prosody, 3);
        let at = |t: usize| {
            let time_s = t as f64 / FPS;
            motion
                .at(time_s, mood.pace * time_s, 1.0, &mood)
                .map(f64::to_degrees)
        };
        (0..60 * 25).map(at).collect()
    }

    /// The same voice with its pitch intervals more than doubled.
    fn lively() -> Prosody {
        let mut prosody = speaking(60, 60);
        prosody.pitch_hz.iter_mut().for_each(|hz| {
            if *hz > 120.0 {
                *hz = 210.0;
            }
        });
        prosody
    }

    fn deviation(track: &[[f64; 3]], axis: usize) -> f64 {
        let mean = track.iter().map(|r| r[axis]).sum::<f64>() / track.len() as f64;
        let power = track.iter().map(|r| (r[axis] - mean).powi(2)).sum::<f64>();
        (power / track.len() as f64).sqrt()
    }

    /// Mean speed, degrees a second.
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
                for (x, most) in turn.iter().zip(MAX_DEG) {
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
                on += at(&motion, time_s, 0.0)[0].to_degrees();
                between += at(&motion, time_s - 0.15, 0.0)[0].to_degrees();
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
            |time_s: f64| (at(&motion, time_s, 0.0)[0] - at(&motion, time_s, 1.0)[0]).to_degrees();
        assert!(lift(3.0 - BREATH_S) > 0.2);
        assert!(lift(1.5).abs() < 1e-3);
    }

    #[test]
    fn lively_speech_nods_by_4_to_8_degrees_on_strong_stresses() {
        let prosody = lively();
        let track = in_mood(&prosody, "neutral:0");
        let calm = in_mood(&speaking(60, 60), "neutral:0");
        let motion = HeadMotion::draw(&prosody, 3);
        let far: Vec<f64> = motion
            .nods
            .iter()
            .filter(|nod| nod.far[0] > 0.0)
            .map(|nod| nod.time_s)
            .collect();
        assert!(far.len() > 15, "{} far nods a minute", far.len());
        // From the highest pose in the 0.6 s before the nod to the lowest within 0.1 s of it.
        let size = |track: &[[f64; 3]], time_s: f64| {
            let t = (time_s * FPS) as usize;
            let pitch = |range: std::ops::Range<usize>| range.map(|t| track[t][0]);
            let high = pitch(t.saturating_sub(15)..t).fold(f64::INFINITY, f64::min);
            pitch(t - 2..t + 3).fold(f64::NEG_INFINITY, f64::max) - high
        };
        let mut sizes: Vec<f64> = far.iter().map(|s| size(&track, *s)).collect();
        sizes.sort_by(f64::total_cmp);
        let (tenth, last) = (sizes.len() / 10, sizes.len() - 1);
        assert!(sizes[tenth] > 4.0 && sizes[last - tenth] < 8.0, "{sizes:?}");
        assert!(far.iter().all(|s| size(&calm, *s) < 4.0));
    }

    #[test]
    fn emotions_carry_the_head_each_in_its_way() {
        let prosody = speaking(60, 60);
        let of = |emotion: &str| in_mood(&prosody, emotion);
        let [sad, neutral, happy, calm, angry] =
            ["sad:1", "neutral:0", "happy:1", "calm:1", "angry:1"].map(of);
        let pitch = |track: &[[f64; 3]]| deviation(track, 0);
        assert!(pitch(&sad) < 0.8 * pitch(&neutral) && pitch(&calm) < 0.8 * pitch(&neutral));
        assert!(pitch(&happy) > 1.5 * pitch(&neutral) && pitch(&angry) > 1.5 * pitch(&neutral));
        assert!(speed(&sad, 0) < 0.6 * speed(&neutral, 0));
        let down =
            |track: &[[f64; 3]]| track.iter().map(|r| r[0]).sum::<f64>() / track.len() as f64;
        assert!(down(&sad) > down(&neutral) + 3.0 && down(&angry) > down(&neutral) + 1.0);
        assert!(down(&happy) < down(&neutral) - 0.5);
    }

    #[test]
    fn the_liveliest_head_turns_smoothly() {
        let track = in_mood(&lively(), "happy:1");
        for axis in 0..3 {
            for three in track.windows(3) {
                let steps = [
                    three[1][axis] - three[0][axis],
                    three[2][axis] - three[1][axis],
                ];
                assert!(
                    FPS * steps[0].abs() < 100.0,
                    "{} degrees a second",
                    FPS * steps[0]
                );
                let change = FPS * FPS * (steps[1] - steps[0]).abs();
                assert!(change < 1500.0, "{change} degrees a second squared");
            }
        }
    }

    #[test]
    fn silence_is_calm_in_every_mood() {
        let silence = Prosody::of(&crate::audio::Waveform {
            samples: vec![0.0; 16_000 * 60],
        });
        for emotion in ["neutral:0", "happy:1", "angry:1"] {
            let track = in_mood(&silence, emotion);
            assert!(
                deviation(&track, 0) < 0.8 && speed(&track, 0) < 2.0,
                "{emotion}"
            );
        }
    }
}
