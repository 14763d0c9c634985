//! Properties of expressions on landmarks.

use std::{ops::Range, sync::Arc};

use ndarray::{Array2, Array3, ArrayView2, Axis, s};

use super::*;
use crate::{
    audio::{PROSODY_FPS, Prosody, Waveform},
    conditions::{EMOTIONS, Emotion, EmotionCurve},
    mesh::ibug::{EYES, LIP_COLUMNS},
    motion::{Cues, FaceModes, LandmarkClip, LandmarkFrame, PerformanceControls},
};

const FPS: f64 = 30.0;
/// Distance between the lids of ICT's neutral face, metres: the subject's right eye, then the left.
const LID_GAPS_M: [[f32; 2]; 2] = [[8.03e-3, 8.51e-3], [8.51e-3, 8.03e-3]];

fn table() -> Expressions {
    Expressions::open(None).unwrap()
}

fn modes() -> FaceModes {
    FaceModes::open(None).unwrap()
}

fn silence() -> Prosody {
    Prosody::of(&Waveform {
        samples: vec![0.0; 1600],
    })
}

fn curve(text: &str) -> EmotionCurve {
    EmotionCurve::parse(text).unwrap()
}

fn still(frames: usize) -> LandmarkClip {
    LandmarkClip {
        displacements: Array3::zeros((frames, 68, 3)),
        fps: FPS,
    }
}

/// A jaw that drops by 14 mm three times a second. In between the lips close and press by 0.3 mm.
fn talking(seconds: f64) -> LandmarkClip {
    let (modes, mut clip) = (modes(), still((seconds * FPS) as usize));
    let jaw = modes.mode("jawOpen").unwrap();
    for (t, mut frame) in clip.displacements.outer_iter_mut().enumerate() {
        let open = (std::f32::consts::TAU * 2.0 * t as f32 / FPS as f32).sin();
        frame.scaled_add(0.5 * open.max(0.0), &jaw);
        if open <= 0.0 {
            for n in [61, 62, 63] {
                frame[[n, 1]] -= 0.3e-3;
            }
        }
    }
    clip
}

fn with(clip: &LandmarkClip, emotion: &EmotionCurve, prosody: &Prosody, seed: u64) -> LandmarkClip {
    let affect = emotion.sample(clip.displacements.dim().0, clip.fps);
    let table = table();
    let cues = Cues {
        affect: affect.view(),
        blink_affect: affect.view(),
        expressions: &table,
        emotion_origin: EmotionOrigin::Added,
        speech_only: false,
        prosody,
        seed,
    };
    let mut out = clip.clone();
    table.add(&mut out, &cues, &modes(), 1.0).unwrap();
    out
}

fn add_emotion(clip: &LandmarkClip, emotion: &str) -> Array3<f32> {
    with(clip, &curve(emotion), &silence(), 3).displacements
}

fn prototype(emotion: &str) -> Array2<f32> {
    let named = |name: &str| if name == emotion { 1.0 } else { 0.0 };
    table().whole(&EMOTIONS.map(named))
}

/// How much of `expression` is in `shown`.
fn projection(shown: ArrayView2<'_, f32>, expression: ArrayView2<'_, f32>) -> f32 {
    (&shown * &expression).sum() / (&expression * &expression).sum()
}

fn mean(motion: &Array3<f32>, frames: Range<usize>) -> Array2<f32> {
    let part = motion.slice(s![frames, .., ..]);
    part.mean_axis(Axis(0)).unwrap()
}

fn gap(frame: ArrayView2<'_, f32>, (up, low): (usize, usize)) -> f32 {
    frame[[up, 1]] - frame[[low, 1]]
}

fn inner_gaps(frame: ArrayView2<'_, f32>) -> [f32; 3] {
    std::array::from_fn(|k| {
        let column = &LIP_COLUMNS[k];
        gap(frame, (column.upper[0].0, column.lower[0].0))
    })
}

/// Mean upward motion of both landmarks, mm.
fn up(face: &Array2<f32>, pair: [usize; 2]) -> f32 {
    500.0 * (face[[pair[0], 1]] + face[[pair[1], 1]])
}

/// How much further two landmarks are apart than in the neutral face, mm.
fn apart(face: &Array2<f32>, right: usize, left: usize) -> f32 {
    1e3 * (face[[left, 0]] - face[[right, 0]])
}

fn lids_apart(face: &Array2<f32>) -> f32 {
    let gaps = EYES.iter().flat_map(|eye| eye.pairs);
    250.0 * gaps.map(|pair| gap(face.view(), pair)).sum::<f32>()
}

#[test]
fn expressions_are_as_strong_as_they_have_to_be_to_be_read() {
    let angry = prototype("angry");
    assert!(up(&angry, [21, 22]) < -4.9 && up(&angry, [19, 24]) < -6.9);
    assert!(apart(&angry, 21, 22) < -3.9);
    let sad = prototype("sad");
    assert!(up(&sad, [21, 22]) > 5.4 && lids_apart(&sad) < -2.9);
    assert!(up(&sad, [48, 54]) < -4.6 && up(&sad, [19, 24]) < 1.0);
    let disgusted = prototype("disgusted");
    assert!(up(&disgusted, [50, 52]) > 9.5 && up(&disgusted, [31, 35]) > 7.0);
    assert!(up(&disgusted, [40, 47]) > 2.0, "lower lids rise");
    let afraid = prototype("afraid");
    assert!(apart(&afraid, 48, 54) > 6.0 && apart(&afraid, 21, 22) < -2.0);
    assert!(up(&afraid, [21, 22]) > 4.0 && lids_apart(&afraid) > 2.0);
    let (happy, surprised) = (prototype("happy"), prototype("surprised"));
    assert!(up(&happy, [48, 54]) > 8.0 && apart(&happy, 48, 54) > 10.0);
    assert!(up(&surprised, [19, 24]) > 8.0 && lids_apart(&surprised) > 2.0);
}

#[test]
fn any_two_emotions_differ() {
    for (a, first) in EMOTIONS.iter().enumerate() {
        for second in &EMOTIONS[a + 1..] {
            let between = prototype(first) - prototype(second);
            let apart = between.map_axis(Axis(1), |d| d.dot(&d).sqrt());
            assert!(
                apart.iter().copied().fold(0.0, f32::max) > 2e-3,
                "{first} {second}"
            );
            let square = apart.mapv(|x| x * x).mean().unwrap();
            assert!(square.sqrt() > 0.8e-3, "{first} {second}");
        }
    }
}

#[test]
fn neutral_changes_no_bit() {
    let clip = talking(2.0);
    for emotion in ["neutral:0", "neutral:1", "off"] {
        assert_eq!(add_emotion(&clip, emotion), clip.displacements, "{emotion}");
    }
}

#[test]
fn a_resting_face_shows_all_that_is_asked_and_half_more_of_it_at_one_and_a_half() {
    for emotion in &EMOTIONS[1..] {
        let expression = prototype(emotion);
        let shown = |strength: f32| {
            let moved = add_emotion(&still(300), &format!("{emotion}:{strength}"));
            projection(mean(&moved, 0..300).view(), expression.view())
        };
        let [full, most] = [1.0, 1.5].map(shown);
        assert!((0.95..1.06).contains(&full), "{emotion}: {full}");
        // Pressed lips and nearly closed lids move less.
        assert!((1.4..1.58).contains(&most), "{emotion}: {most}");
    }
}

#[test]
fn what_does_not_speak_shows_the_whole_expression_while_the_mouth_speaks() {
    let clip = talking(6.0);
    for emotion in &EMOTIONS[1..] {
        let moved = add_emotion(&clip, &format!("{emotion}:1")) - &clip.displacements;
        let upper = s![17..48, ..];
        let (shown, expression) = (mean(&moved, 0..180), prototype(emotion));
        let share = projection(shown.slice(upper), expression.slice(upper));
        assert!((0.95..1.06).contains(&share), "{emotion}: {share}");
    }
}

#[test]
fn closed_lips_stay_closed_and_none_pass() {
    let clip = talking(4.0);
    for (emotion, strength) in EMOTIONS[1..].iter().flat_map(|e| [(e, 1.0), (e, 1.5)]) {
        let moved = add_emotion(&clip, &format!("{emotion}:{strength}"));
        for (spoken, shown) in clip.displacements.outer_iter().zip(moved.outer_iter()) {
            for (had, has) in inner_gaps(spoken).into_iter().zip(inner_gaps(shown)) {
                assert!(has > -0.51e-3, "{emotion}:{strength} lips pass: {has}");
                assert!(
                    had > 0.0 || has < 0.1e-3,
                    "{emotion}:{strength} opens: {has}"
                );
            }
        }
    }
}

#[test]
fn lips_that_rest_may_part() {
    let surprised = add_emotion(&still(90), "surprised:1");
    assert!(inner_gaps(surprised.index_axis(Axis(0), 45))[1] > 4e-3);
}

#[test]
fn lids_never_cross_even_where_they_blink_at_full_strength() {
    let (modes, table) = (modes(), table());
    let controls = PerformanceControls {
        blinks_per_minute: 60.0,
        ..PerformanceControls::as_sampled()
    };
    for emotion in &EMOTIONS[1..] {
        let affect = curve(&format!("{emotion}:1.5")).sample(240, FPS);
        let cues = Cues {
            affect: affect.view(),
            blink_affect: affect.view(),
            expressions: &table,
            emotion_origin: EmotionOrigin::Added,
            speech_only: false,
            prosody: &silence(),
            seed: 5,
        };
        let clip = modes.apply_controls(&still(240), &cues, &controls).unwrap();
        let mut least = f32::INFINITY;
        for frame in clip.displacements.outer_iter() {
            for (eye, gaps) in EYES.iter().zip(LID_GAPS_M) {
                for (pair, open) in eye.pairs.into_iter().zip(gaps) {
                    least = least.min(open + gap(frame, pair));
                }
            }
        }
        assert!(least > -0.3e-3, "{emotion}: {least}");
        assert!(least < 0.3e-3, "{emotion}: a blink leaves {least}");
    }
}

/// Frames from `from` on until a step of the left brow has gone `share` of its way.
fn frames_until(track: &[f32], from: usize, share: f32) -> usize {
    let (start, end) = (track[from - 1], *track.last().unwrap());
    let reached = |x: &f32| ((x - start) / (end - start)) >= share;
    track[from..].iter().position(reached).unwrap() + 1
}

#[test]
fn an_emotion_comes_within_its_onset_smoothly_and_goes_slower() {
    let step = |on: bool| {
        let strength = |is_on: bool| if is_on { 1.0 } else { 0.0 };
        let keys = |at: f64, is_on: bool| {
            let emotion = Emotion::parse(&format!("angry:{}", strength(is_on))).unwrap();
            (at, emotion)
        };
        let curve = EmotionCurve::Keys(vec![keys(1.0, !on), (keys(1.0 + 1e-9, on))]);
        table().alone(curve.sample(150, FPS).view(), FPS, 1.0)
    };
    let track = |motion: Array3<f32>| motion.slice(s![.., 22, 1]).to_vec();
    let (comes, goes) = (track(step(true)), track(step(false)));
    assert!(comes[..31].iter().all(|x| *x == 0.0));
    let onset_s = frames_until(&comes, 31, 0.9) as f64 / FPS;
    let offset_s = frames_until(&goes, 31, 0.9) as f64 / FPS;
    assert!((0.3..0.42).contains(&onset_s), "{onset_s}");
    assert!(
        offset_s > 1.4 * onset_s && offset_s < 2.0 * onset_s,
        "{offset_s}"
    );
    let steps = comes
        .windows(2)
        .map(|pair| ((pair[1] - pair[0]) / comes[149]).abs());
    assert!(steps.fold(0.0, f32::max) < 0.2);
    assert_eq!(goes[149], 0.0);
}

#[test]
fn onsets_take_as_long_at_any_frame_rate_and_none_overshoots() {
    for emotion in &EMOTIONS[1..] {
        let onset = |fps: f64| {
            let rising = Emotion::parse(&format!("{emotion}:1")).unwrap();
            let keys = vec![(0.5, Emotion::default()), (0.5 + 1e-9, rising)];
            let affect = EmotionCurve::Keys(keys).sample((4.0 * fps) as usize, fps);
            let shown = table().followed(affect.view(), fps, 1.0);
            let e = EMOTIONS.iter().position(|known| known == emotion).unwrap();
            assert!(shown.iter().all(|s| (0.0..=1.0 + 1e-6).contains(&s[e])));
            let first = shown.iter().position(|s| s[e] >= 0.9).unwrap();
            first as f64 / fps - 0.5
        };
        let (film, fine) = (onset(25.0), onset(200.0));
        assert!((0.28..0.62).contains(&fine), "{emotion}: {fine}");
        assert!((film - fine).abs() < 0.06, "{emotion}: {film} {fine}");
    }
}

#[test]
fn the_apex_is_not_frozen_and_follows_the_seed() {
    let clip = still(600);
    let brow = |seed| {
        let moved = with(&clip, &curve("angry:1"), &silence(), seed).displacements;
        moved.slice(s![.., 22, 1]).to_vec()
    };
    let track = brow(1);
    let mean = track.iter().sum::<f32>() / 600.0;
    let variance = track.iter().map(|x| (x / mean - 1.0).powi(2)).sum::<f32>() / 600.0;
    assert!(
        (0.1..0.25).contains(&variance.sqrt()),
        "{}",
        variance.sqrt()
    );
    let fastest = track.windows(2).map(|p| ((p[1] - p[0]) / mean).abs());
    assert!(fastest.fold(0.0, f32::max) < 0.06);
    assert_eq!(track, brow(1));
    assert_ne!(track, brow(2));
}

#[test]
fn stressed_syllables_make_it_grow() {
    let frames = (10.0 * PROSODY_FPS) as usize;
    let strong = |t: usize| (400..450).contains(&t);
    let prosody = Prosody {
        level_db: (0..frames)
            .map(|t| if strong(t) { -12.0 } else { -25.0 })
            .collect(),
        pitch_hz: (0..frames)
            .map(|t| if strong(t) { 190.0 } else { 120.0 })
            .collect(),
        effort_db: vec![-9.0; frames],
        loud_db: -12.0,
        nuclei: (0..20).map(|k| 50 * k + 25).collect(),
        pauses: Vec::new(),
    };
    let (clip, sad) = (still(300), curve("sad:1"));
    let plain = with(&clip, &sad, &silence(), 4).displacements;
    let stressed = with(&clip, &sad, &prosody, 4).displacements;
    let grown = |t: usize| stressed[[t, 21, 1]] / plain[[t, 21, 1]];
    assert!((1.1..1.25).contains(&grown(127)), "{}", grown(127));
    assert!((grown(60) - 1.0).abs() < 1e-6 && (grown(200) - 1.0).abs() < 1e-6);
}

#[test]
fn anger_and_joy_speak_larger_and_faster_and_sadness_smaller_as_speakers_do() {
    let clip = talking(4.0);
    let measures = |emotion: &str| {
        let moved = add_emotion(&clip, emotion);
        let gaps: Vec<f32> = moved
            .outer_iter()
            .map(|frame| inner_gaps(frame)[1])
            .collect();
        let high = gaps.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let low = gaps.iter().copied().fold(f32::INFINITY, f32::min);
        let speed: f32 = gaps.windows(2).map(|p| (p[1] - p[0]).abs()).sum();
        (high - low, speed)
    };
    let (range, speed) = measures("neutral:0");
    for (emotion, least, most) in [
        ("angry:1", 1.1, 1.5),
        ("happy:1", 1.08, 1.4),
        ("sad:1", 0.65, 0.95),
    ] {
        let (emotional_range, emotional_speed) = measures(emotion);
        assert!(
            (least..most).contains(&(emotional_range / range)),
            "{emotion}: {}",
            emotional_range / range
        );
        assert!(
            (least..1.6).contains(&(emotional_speed / speed)),
            "{emotion}: {}",
            emotional_speed / speed
        );
    }
}

fn causal() -> CausalExpression {
    CausalExpression::new(Arc::new(table()), Arc::new(modes()), FPS).unwrap()
}

/// What a stream makes of a clip whose voice is heard throughout.
fn streamed(clip: &LandmarkClip, emotion: impl Fn(usize) -> Emotion) -> Array3<f32> {
    let mut expression = causal();
    let mut out = clip.displacements.clone();
    for (index, mut row) in out.outer_iter_mut().enumerate() {
        let mut frame = LandmarkFrame {
            index,
            displacements: std::array::from_fn(|n| std::array::from_fn(|k| row[[n, k]])),
        };
        expression.add(&mut frame, &emotion(index), 0.0);
        for ((n, axis), x) in row.indexed_iter_mut() {
            *x = frame.displacements[n][axis];
        }
    }
    out
}

#[test]
fn a_stream_acts_on_the_next_frame_keeps_closures_and_shows_all() {
    let clip = talking(24.0);
    let change = 60;
    for emotion in &EMOTIONS[1..] {
        let full = Emotion::parse(&format!("{emotion}:1")).unwrap();
        let shown = streamed(
            &clip,
            |t| if t < change { Emotion::default() } else { full },
        );
        let before = s![..change, .., ..];
        assert_eq!(shown.slice(before), clip.displacements.slice(before));
        assert_ne!(
            shown.index_axis(Axis(0), change),
            clip.displacements.index_axis(Axis(0), change)
        );
        let upper = s![17..48, ..];
        let moved = mean(&(&shown - &clip.displacements), 90..720);
        let share = projection(moved.slice(upper), prototype(emotion).slice(upper));
        assert!((0.85..1.35).contains(&share), "{emotion}: {share}");
        for (spoken, shown) in clip.displacements.outer_iter().zip(shown.outer_iter()) {
            let (had, has) = (inner_gaps(spoken)[1], inner_gaps(shown)[1]);
            assert!(
                has > -0.51e-3 && (had > 0.0 || has < 0.1e-3),
                "{emotion}: {has}"
            );
        }
    }
}

#[test]
fn a_stream_starts_settled_and_rests_when_nobody_speaks() {
    let mut expression = causal();
    let surprised = Emotion::parse("surprised:1").unwrap();
    let mut frames = (0..40).map(|index| {
        let mut frame = LandmarkFrame {
            index,
            displacements: [[0.0; 3]; 68],
        };
        // Somebody speaks from the twentieth frame on.
        expression.add(&mut frame, &surprised, if index < 20 { 9.0 } else { 0.0 });
        frame.displacements
    });
    let gap = |face: [[f32; 3]; 68]| face[62][1] - face[66][1];
    let first = frames.next().unwrap();
    assert!(first[22][1] > 7e-3 && gap(first) > 4e-3);
    let last = frames.last().unwrap();
    assert!(
        gap(last) < 0.1e-3,
        "lips that are closed in speech stay closed"
    );
}
