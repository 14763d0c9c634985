//! Gestures of an emotion: how brows, lids, cheeks, nose and mouth corners move while it lasts.
//!
//! A felt expression is not a still pose. It appears again and again for half a second to four seconds
//! (Ekman & Friesen 1982). It rises in about half a second, fades more slowly (Schmidt et al. 2006)
//! and is rarely the same on both sides. So each of three tracks (brows; lids, cheeks and nose; corners
//! and chin) plays one gesture after another: onset, apex, offset, pause. The gestures of an emotion
//! follow its action units. Their strength is our own choice, so that brows vary by about a millimetre
//! over a take. Sad faces gesture slowly and happy ones fast, just as their heads move.

use ndarray::{Array2, Array3, ArrayViewMut2};

use super::{FaceModes, articulation::keep_closures, chance::Chance, mood, phrases::smooth_step};
use crate::{
    Result,
    conditions::{EMOTIONS, Strengths},
    mesh::ibug::{LANDMARKS, MOUTH},
};

/// First of the random streams of the gestures: one for each track.
const STREAM: u64 = u64::MAX - 110;
/// Least and greatest duration of a gesture's parts and of the pause after it, at a pace of 1, seconds.
const ONSET_S: (f64, f64) = (0.3, 0.55);
const APEX_S: (f64, f64) = (0.3, 1.5);
const OFFSET_S: (f64, f64) = (0.5, 0.95);
const PAUSE_S: (f64, f64) = (0.2, 1.4);
/// Least and greatest size of a gesture, as a share of its pattern.
const SIZE: (f64, f64) = (0.75, 1.3);
/// The share by which a gesture may at most be larger on one side and smaller on the other.
const SIDE: f64 = 0.3;

/// The shapes of gestures by their names in [`FaceModes`], the right and the left one of each pair.
const PAIRS: [[&str; 2]; 13] = [
    ["browInnerUp_R", "browInnerUp_L"],
    ["browOuterUp_R", "browOuterUp_L"],
    ["browDown_R", "browDown_L"],
    ["eyeSquint_R", "eyeSquint_L"],
    ["eyeWide_R", "eyeWide_L"],
    ["eyeBlink_R", "eyeBlink_L"],
    ["cheekSquint_R", "cheekSquint_L"],
    ["noseSneer_R", "noseSneer_L"],
    ["mouthSmile_R", "mouthSmile_L"],
    ["mouthFrown_R", "mouthFrown_L"],
    ["mouthDimple_R", "mouthDimple_L"],
    ["mouthPress_R", "mouthPress_L"],
    ["mouthShrugLower", "mouthShrugLower"],
];
const INNER: usize = 0;
const OUTER: usize = 1;
const KNIT: usize = 2;
const SQUINT: usize = 3;
const WIDE: usize = 4;
const DROOP: usize = 5;
const CHEEK: usize = 6;
const NOSE: usize = 7;
const SMILE: usize = 8;
const FROWN: usize = 9;
const DIMPLE: usize = 10;
const PRESS: usize = 11;
const CHIN: usize = 12;

/// Weight of each pair of shapes, the subject's right and left.
pub(super) type GestureWeights = [[f32; 2]; PAIRS.len()];

/// Weights of a gesture at its apex under an emotion of strength 1: pair, right, left.
type Pattern = &'static [(usize, f32, f32)];

const TRACKS: usize = 3;

/// The gestures of each emotion, in the order of [`EMOTIONS`]: brows; lids, cheeks and nose;
/// corners and chin.
static PATTERNS: [[&[Pattern]; TRACKS]; EMOTIONS.len()] = [
    [&[], &[], &[]],
    // happy
    [
        &[
            &[(INNER, 0.2, 0.2), (OUTER, 0.2, 0.2)],
            &[(INNER, 0.12, 0.12), (OUTER, 0.29, 0.12)],
            &[(OUTER, -0.1, -0.1), (KNIT, 0.07, 0.07)],
        ],
        &[
            &[(CHEEK, 0.25, 0.25), (SQUINT, 0.2, 0.2)],
            &[(CHEEK, -0.4, -0.4)],
            &[(WIDE, 0.35, 0.35)],
        ],
        &[
            &[(SMILE, 0.2, 0.2)],
            &[(SMILE, -0.22, -0.22)],
            &[(DIMPLE, 0.3, 0.15)],
        ],
    ],
    // pleased
    [
        &[
            &[(INNER, 0.25, 0.25), (OUTER, 0.23, 0.23)],
            &[(INNER, 0.31, 0.31)],
            &[(OUTER, 0.12, 0.33)],
        ],
        &[
            &[(SQUINT, 0.35, 0.35), (CHEEK, 0.25, 0.25)],
            &[(WIDE, 0.25, 0.25)],
        ],
        &[
            &[(SMILE, 0.15, 0.15)],
            &[(SMILE, -0.12, -0.12)],
            &[(DIMPLE, 0.3, 0.2)],
        ],
    ],
    // calm
    [
        &[
            &[(INNER, 0.19, 0.19), (OUTER, 0.15, 0.15)],
            &[(INNER, 0.22, 0.22)],
        ],
        &[&[(DROOP, 0.14, 0.14)], &[(SQUINT, 0.2, 0.2)]],
        &[&[(SMILE, 0.08, 0.08)]],
    ],
    // surprised
    [
        &[
            &[(INNER, -0.12, -0.12), (OUTER, -0.09, -0.09)],
            &[(INNER, 0.06, 0.06), (KNIT, 0.15, 0.15)],
            &[(OUTER, -0.15, 0.0)],
        ],
        &[&[(WIDE, 0.35, 0.35)], &[(WIDE, -0.45, -0.45)]],
        &[&[(SMILE, 0.1, 0.1)], &[(FROWN, 0.2, 0.2)]],
    ],
    // sad
    [
        &[
            &[(INNER, 0.35, 0.35), (KNIT, 0.15, 0.15)],
            &[(INNER, -0.4, -0.4)],
            &[(KNIT, 0.35, 0.35)],
        ],
        &[
            &[(DROOP, 0.05, 0.05)],
            &[(SQUINT, 0.35, 0.35), (CHEEK, 0.25, 0.25)],
            &[(DROOP, -0.15, -0.15)],
        ],
        &[
            &[(FROWN, 0.35, 0.35), (CHIN, 0.04, 0.04)],
            &[(PRESS, 0.35, 0.35)],
            &[(FROWN, -0.4, -0.4)],
        ],
    ],
    // upset
    [
        &[
            &[(KNIT, 0.24, 0.24)],
            &[(INNER, 0.27, 0.27)],
            &[(KNIT, -0.27, -0.27), (INNER, 0.07, 0.07)],
        ],
        &[
            &[(SQUINT, 0.35, 0.35)],
            &[(NOSE, 0.18, 0.18)],
            &[(DROOP, 0.14, 0.14)],
        ],
        &[&[(FROWN, 0.35, 0.35)], &[(PRESS, 0.4, 0.4)]],
    ],
    // ashamed
    [
        &[
            &[(INNER, 0.42, 0.42)],
            &[(INNER, 0.2, 0.2), (KNIT, 0.35, 0.35)],
            &[(KNIT, 0.35, 0.35)],
        ],
        &[
            &[(DROOP, 0.08, 0.08)],
            &[(SQUINT, 0.25, 0.25)],
            &[(DROOP, -0.15, -0.15)],
        ],
        &[
            &[(PRESS, 0.35, 0.35)],
            &[(DIMPLE, 0.45, 0.3)],
            &[(FROWN, 0.3, 0.3)],
        ],
    ],
    // afraid
    [
        &[
            &[(INNER, 0.17, 0.17), (OUTER, 0.12, 0.12)],
            &[(KNIT, 0.22, 0.22)],
            &[(INNER, -0.24, -0.24), (OUTER, -0.09, -0.09)],
        ],
        &[
            &[(WIDE, 0.4, 0.4)],
            &[(WIDE, -0.5, -0.5)],
            &[(SQUINT, 0.35, 0.35)],
        ],
        &[&[(FROWN, 0.3, 0.3)], &[(PRESS, 0.35, 0.35)]],
    ],
    // angry
    [
        &[
            &[(KNIT, 0.17, 0.17)],
            &[(KNIT, -0.25, -0.25)],
            &[(INNER, 0.08, 0.08), (OUTER, 0.19, 0.06)],
        ],
        &[
            &[(NOSE, 0.22, 0.22)],
            &[(SQUINT, 0.4, 0.4)],
            &[(WIDE, 0.4, 0.4)],
        ],
        &[&[(PRESS, 0.45, 0.45)], &[(FROWN, 0.35, 0.35)]],
    ],
    // disgusted
    [
        &[
            &[(KNIT, 0.23, 0.23)],
            &[(INNER, 0.23, 0.23), (KNIT, 0.07, 0.07)],
            &[(KNIT, -0.16, -0.16), (OUTER, 0.16, 0.16)],
        ],
        &[
            &[(NOSE, 0.28, 0.28)],
            &[(NOSE, -0.3, -0.3)],
            &[(SQUINT, 0.35, 0.35), (CHEEK, 0.25, 0.25)],
        ],
        &[&[(FROWN, 0.35, 0.35)], &[(DIMPLE, 0.35, 0.2)]],
    ],
    // contempt
    [
        &[
            &[(OUTER, 0.0, 0.32), (INNER, 0.08, 0.16)],
            &[(OUTER, 0.26, -0.16)],
            &[(KNIT, 0.24, 0.24)],
        ],
        &[
            &[(DROOP, 0.14, 0.14)],
            &[(SQUINT, 0.35, 0.2)],
            &[(NOSE, 0.22, 0.0)],
        ],
        &[
            &[(DIMPLE, 0.3, 0.0), (SMILE, 0.08, 0.0)],
            &[(DIMPLE, -0.35, 0.0)],
        ],
    ],
    // suspicious
    [
        &[
            &[(OUTER, 0.0, 0.24), (KNIT, 0.17, 0.0)],
            &[(KNIT, 0.22, 0.22)],
            &[(OUTER, 0.0, -0.29)],
        ],
        &[
            &[(SQUINT, 0.4, 0.4)],
            &[(SQUINT, -0.4, -0.4)],
            &[(DROOP, 0.1, 0.1)],
        ],
        &[&[(PRESS, 0.4, 0.4)], &[(DIMPLE, 0.0, 0.35)]],
    ],
    // ill
    [
        &[
            &[(KNIT, 0.31, 0.31)],
            &[(INNER, 0.35, 0.35)],
            &[(KNIT, -0.28, -0.28)],
        ],
        &[
            &[(DROOP, 0.16, 0.16)],
            &[(SQUINT, 0.35, 0.35), (NOSE, 0.12, 0.12)],
        ],
        &[&[(FROWN, 0.3, 0.3)], &[(PRESS, 0.25, 0.25)]],
    ],
    // drunk
    [
        &[
            &[(INNER, 0.25, 0.25), (OUTER, 0.22, 0.22)],
            &[(OUTER, 0.31, 0.0)],
            &[(INNER, -0.12, -0.12), (KNIT, 0.15, 0.15)],
        ],
        &[
            &[(DROOP, 0.18, 0.18)],
            &[(DROOP, 0.0, 0.2)],
            &[(WIDE, 0.25, 0.25)],
        ],
        &[&[(SMILE, 0.0, 0.2)], &[(FROWN, 0.2, 0.0)]],
    ],
];

/// One gesture of a track. Its times are on the clock of [`Gestures`].
struct Gesture {
    start_s: f64,
    onset_s: f64,
    apex_s: f64,
    offset_s: f64,
    pause_s: f64,
    /// Picks one of an emotion's patterns: its place in their list, 0 to 1.
    pick: f64,
    size: f64,
    /// Share by which it is larger on the left and smaller on the right.
    side: f64,
}

impl Gesture {
    fn draw(chance: &mut Chance, start_s: f64) -> Self {
        let mut between = |(low, high)| chance.between(low, high);
        Gesture {
            start_s,
            onset_s: between(ONSET_S),
            apex_s: between(APEX_S),
            offset_s: between(OFFSET_S),
            pause_s: between(PAUSE_S),
            pick: between((0.0, 1.0)),
            size: between(SIZE),
            side: between((-SIDE, SIDE)),
        }
    }

    fn end_s(&self) -> f64 {
        self.start_s + self.onset_s + self.apex_s + self.offset_s
    }

    /// 0 before and after it, 1 at the apex.
    fn share(&self, clock_s: f64) -> f64 {
        let rising = smooth_step((clock_s - self.start_s) / self.onset_s);
        let falling = smooth_step((self.end_s() - clock_s) / self.offset_s);
        rising.min(falling)
    }
}

/// The gestures of a take, frame by frame. The same seed gives the same gestures.
pub(super) struct Gestures {
    /// Time that passes at the emotion's pace.
    clock_s: f64,
    tracks: [(Chance, Gesture); TRACKS],
}

impl Gestures {
    pub(super) fn new(seed: u64) -> Self {
        let track = |number: usize| {
            let mut chance = Chance::new(seed, STREAM + number as u64);
            let start_s = chance.between(0.0, PAUSE_S.1);
            let first = Gesture::draw(&mut chance, start_s);
            (chance, first)
        };
        Gestures {
            clock_s: 0.0,
            tracks: std::array::from_fn(track),
        }
    }

    /// The weights of the next frame under emotions of these strengths. The frame after it comes
    /// `step_s` seconds later.
    pub(super) fn step(&mut self, strengths: &Strengths, step_s: f64) -> GestureWeights {
        let clock_s = self.clock_s;
        self.clock_s += step_s * mood::pace(strengths);
        let mut weights = [[0.0; 2]; PAIRS.len()];
        for (number, (chance, gesture)) in self.tracks.iter_mut().enumerate() {
            while clock_s >= gesture.end_s() + gesture.pause_s {
                *gesture = Gesture::draw(chance, gesture.end_s() + gesture.pause_s);
            }
            let share = gesture.size * gesture.share(clock_s);
            if share == 0.0 {
                continue;
            }
            for (patterns, strength) in PATTERNS.iter().zip(strengths) {
                let patterns = patterns[number];
                let pick = (gesture.pick * patterns.len() as f64) as usize;
                let Some(pattern) = patterns.get(pick).filter(|_| *strength != 0.0) else {
                    continue;
                };
                let right = f64::from(*strength) * share * (1.0 - gesture.side);
                let left = f64::from(*strength) * share * (1.0 + gesture.side);
                for (pair, to_right, to_left) in *pattern {
                    weights[*pair][0] += right as f32 * to_right;
                    weights[*pair][1] += left as f32 * to_left;
                }
            }
        }
        weights
    }
}

/// Displacements of the landmarks under the shapes of gestures. Shapes above the mouth leave the mouth
/// still.
pub(super) struct GestureModes(Vec<[Array2<f32>; 2]>);

impl GestureModes {
    /// # Errors
    /// `Weights` where `modes` lack a shape.
    pub(super) fn of(modes: &FaceModes) -> Result<Self> {
        let mode = |pair: usize, side: usize| -> Result<Array2<f32>> {
            let mut mode = modes.mode(PAIRS[pair][side])?.to_owned();
            if pair < SMILE {
                MOUTH.for_each(|n| mode.row_mut(n).fill(0.0));
            }
            if pair == CHIN {
                mode *= 0.5;
            }
            Ok(mode)
        };
        let pairs = (0..PAIRS.len()).map(|pair| Ok([mode(pair, 0)?, mode(pair, 1)?]));
        Ok(GestureModes(pairs.collect::<Result<_>>()?))
    }

    /// Adds gestures to a frame, `[68, 3]`, canonical metres.
    pub(super) fn add(&self, frame: &mut ArrayViewMut2<'_, f32>, weights: &GestureWeights) {
        debug_assert_eq!(frame.nrows(), LANDMARKS);
        for (modes, weights) in self.0.iter().zip(weights) {
            for (mode, weight) in modes.iter().zip(weights) {
                if *weight != 0.0 {
                    frame.scaled_add(*weight, mode);
                }
            }
        }
    }
}

/// Adds gestures to `moved` `[T, 68, 3]`, canonical metres, under emotions of `strengths` `[T]`. Closed
/// lips stay closed.
///
/// # Errors
/// `Weights` where `modes` lack a shape.
pub(super) fn gesture(
    moved: &mut Array3<f32>,
    strengths: &[Strengths],
    fps: f64,
    seed: u64,
    modes: &FaceModes,
    size: f32,
) -> Result<()> {
    if !strengths
        .iter()
        .flat_map(|row| &row[1..])
        .any(|x| *x != 0.0)
    {
        return Ok(());
    }
    let (modes, mut gestures) = (GestureModes::of(modes)?, Gestures::new(seed));
    let before = moved.clone();
    for (mut frame, strengths) in moved.outer_iter_mut().zip(strengths) {
        let weights = gestures.step(strengths, 1.0 / fps);
        modes.add(&mut frame, &weights.map(|pair| pair.map(|x| size * x)));
    }
    keep_closures(moved, before.view(), fps);
    Ok(())
}

/// ARKit's names of the shapes of each pair, the subject's right and left.
pub(super) fn arkit_names() -> impl Iterator<Item = [String; 2]> {
    PAIRS.iter().enumerate().map(|(pair, names)| match pair {
        INNER => ["browInnerUp", "browInnerUp"].map(str::to_owned),
        _ => names.map(|name| name.replace("_R", "Right").replace("_L", "Left")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        conditions::EmotionCurve,
        mesh::ibug::BROWS,
        motion::phrases::tests::speaking,
        motion::{Cues, EmotionOrigin, Expressions, LandmarkClip, PerformanceControls},
    };

    const FPS: f64 = 30.0;
    const FRAMES: usize = 900;

    /// Half a minute of a face that does not speak, under an emotion and without blinks; `[T, 68, 3]`.
    fn performed(emotion: &str, variety: f32, seed: u64) -> Array3<f32> {
        let (expressions, modes) = (
            Expressions::open(None).unwrap(),
            FaceModes::open(None).unwrap(),
        );
        let affect = EmotionCurve::parse(emotion).unwrap().sample(FRAMES, FPS);
        let prosody = speaking(30, 60);
        let cues = Cues {
            affect: affect.view(),
            blink_affect: affect.view(),
            expressions: &expressions,
            emotion_origin: EmotionOrigin::Added,
            speech_only: false,
            prosody: &prosody,
            seed,
        };
        let controls = PerformanceControls {
            variety,
            ..PerformanceControls::as_sampled()
        };
        let still = LandmarkClip {
            displacements: Array3::zeros((FRAMES, LANDMARKS, 3)),
            fps: FPS,
        };
        modes
            .apply_controls(&still, &cues, &controls)
            .unwrap()
            .displacements
    }

    /// Motion of the brows by the emotion alone, `[T, 30]`, millimetres about their mean over time.
    fn brows(emotion: &str, seed: u64) -> Vec<Vec<f64>> {
        let with = performed(&format!("{emotion}:1"), 1.0, seed);
        let without = performed("neutral", 1.0, seed);
        let mut rows: Vec<Vec<f64>> = (0..FRAMES)
            .map(|t| {
                let values = BROWS.flat_map(|n| (0..3).map(move |i| (n, i)));
                values
                    .map(|(n, i)| 1e3 * f64::from(with[[t, n, i]] - without[[t, n, i]]))
                    .collect()
            })
            .collect();
        for column in 0..rows[0].len() {
            let mean = rows.iter().map(|row| row[column]).sum::<f64>() / FRAMES as f64;
            rows.iter_mut().for_each(|row| row[column] -= mean);
        }
        rows
    }

    fn square(row: &[f64]) -> f64 {
        row.iter().map(|x| x * x).sum::<f64>() / BROWS.len() as f64
    }

    #[test]
    fn brows_under_an_emotion_move_by_a_millimetre_and_smoothly() {
        for emotion in &EMOTIONS[1..] {
            let takes: Vec<_> = (0..4).map(|seed| brows(emotion, seed)).collect();
            let all = takes.iter().flatten();
            let deviation = (all.map(|row| square(row)).sum::<f64>() / (4 * FRAMES) as f64).sqrt();
            let least = if *emotion == "calm" { 0.6 } else { 0.8 };
            assert!(
                (least..2.0).contains(&deviation),
                "{emotion}: {deviation} mm"
            );
            let steps = takes.iter().flat_map(|take| take.windows(2)).map(|pair| {
                let step: Vec<f64> = pair[1].iter().zip(&pair[0]).map(|(a, b)| a - b).collect();
                square(&step).sqrt()
            });
            let fastest = steps.fold(0.0, f64::max);
            assert!(fastest < 1.0, "{emotion}: {fastest} mm in a frame");
        }
    }

    #[test]
    fn hardly_two_seconds_of_half_a_minute_look_alike() {
        for emotion in ["happy", "sad", "angry", "afraid"] {
            let take = brows(emotion, 7);
            let second = |k: usize| take[k * 30 + 15].clone();
            let pairs = (0..30).flat_map(|a| (a + 2..30).map(move |b| (a, b)));
            let alike = pairs.filter(|(a, b)| {
                let apart: Vec<f64> = second(*a)
                    .iter()
                    .zip(second(*b))
                    .map(|(x, y)| x - y)
                    .collect();
                square(&apart).sqrt() < 0.1
            });
            let count = alike.count();
            assert!(count < 40, "{emotion}: {count} of 406 pairs");
        }
    }

    #[test]
    fn a_neutral_face_and_variety_0_have_no_gestures() {
        let still = Array3::<f32>::zeros((FRAMES, LANDMARKS, 3));
        assert_eq!(performed("neutral", 0.0, 1), still);
        let (happy, again) = (performed("happy:1", 0.0, 1), performed("happy:1", 0.0, 1));
        assert_eq!(happy, again);
        let calm = |seed| performed("happy:1", 1.0, seed);
        assert_ne!(calm(1), happy);
        assert_eq!(calm(1), calm(1));
        assert_ne!(calm(1), calm(2));
    }

    #[test]
    fn gestures_are_smooth_at_any_pace_and_those_of_contempt_lean_to_one_side() {
        let contempt = EMOTIONS
            .iter()
            .position(|name| *name == "contempt")
            .unwrap();
        let strengths = std::array::from_fn(|e| f32::from(e == contempt));
        let mut gestures = Gestures::new(3);
        let mut sides = [0.0f32; 2];
        for _ in 0..3000 {
            let weights = gestures.step(&strengths, 0.02);
            for (side, sum) in sides.iter_mut().enumerate() {
                *sum += weights[DIMPLE][side].abs();
            }
        }
        assert!(sides[0] > 1.0 && sides[1] == 0.0, "{sides:?}");
    }

    #[test]
    fn every_shape_of_a_gesture_has_a_mode_and_a_channel() {
        let modes = FaceModes::open(None).unwrap();
        GestureModes::of(&modes).unwrap();
        let names: Vec<String> = arkit_names().flatten().collect();
        modes.of_shapes(&names).unwrap();
    }
}
