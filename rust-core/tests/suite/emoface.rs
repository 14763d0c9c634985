//! EmoFace through the engine: content and emotion, apart and together.

use std::sync::{Arc, LazyLock};

use anyface::{
    Engine, Error, MotionRequest, Result,
    audio::Waveform,
    conditions::{Controls, EmotionCurve},
    face::FaceOptions,
    job::SILENT,
    mesh::{LandmarkSource, PartChoices},
    models::Weights,
    motion::{Motion, Pose},
    speech::{VoiceTrack, WhisperEar},
    spread::{Collector, FrameSink, Movement, SpreadReport, TemplateOnFace},
    systems::emoface::{EmoFaceConfig, MODEL, read_template},
};
use ndarray::{Array2, Array3, Axis};

use crate::{engine, head, voice::babble};

const SECONDS: f32 = 2.0;

static ENGINE: LazyLock<Engine> = LazyLock::new(|| engine("emoface"));

fn voice(seconds: f32) -> Waveform {
    Waveform {
        samples: babble(seconds, 16_000),
    }
}

/// A request with some controls, and with nothing that chance adds.
fn request_with(controls: &[(&str, f32)]) -> MotionRequest {
    let still = ["blinks_per_minute", "brow_accents", "gaze", "head_motion"];
    let still = still.iter().fold(Controls::default(), |controls, name| {
        controls.with(name, 0.0)
    });
    MotionRequest {
        fps: 25.0,
        controls: controls
            .iter()
            .fold(still, |all, (name, value)| all.with(name, *value)),
        ..MotionRequest::default()
    }
}

fn with_emotion(controls: &[(&str, f32)], emotion: &str) -> MotionRequest {
    MotionRequest {
        emotion: EmotionCurve::parse(emotion).unwrap(),
        ..request_with(&[&[("emotion_from", 1.0)], controls].concat())
    }
}

fn performed(request: &MotionRequest) -> Result<Array3<f32>> {
    let motion = ENGINE.perform(&voice(SECONDS), request, SILENT)?.motion;
    match motion {
        Motion::Codes(clip) => Ok(clip.landmarks.displacements),
        other => panic!("expected codes, got {}", other.kind()),
    }
}

/// Mean distance between the landmarks of two motions, mm.
fn apart_mm(one: &Array3<f32>, other: &Array3<f32>) -> f32 {
    let squares = (one - other).mapv(|x| x * x);
    let distance = squares.sum_axis(ndarray::Axis(2)).mapv(f32::sqrt);
    1e3 * distance.mean().unwrap()
}

#[test]
fn what_is_said_does_not_hear_what_is_felt() {
    let layer =
        |number: f32, emotion| performed(&with_emotion(&[("layer", number)], emotion)).unwrap();
    assert_eq!(layer(1.0, "happy"), layer(1.0, "angry"));
    for number in [0.0, 2.0] {
        let between = apart_mm(&layer(number, "happy"), &layer(number, "angry"));
        assert!(between > 0.3, "{number} {between}");
    }
}

#[test]
fn more_of_a_emotion_moves_the_face_further_from_rest() {
    let at = |level: f32| performed(&with_emotion(&[("emotion_level", level)], "happy")).unwrap();
    let none = at(0.0);
    let steps: Vec<f32> = [0.5, 1.0, 1.5].map(|l| apart_mm(&at(l), &none)).to_vec();
    assert!(steps.windows(2).all(|pair| pair[0] < pair[1]), "{steps:?}");
}

#[test]
fn an_emotion_that_is_asked_for_by_name_is_what_is_felt() {
    let by_name = |emotion: &str| MotionRequest {
        emotion: EmotionCurve::parse(emotion).unwrap(),
        ..request_with(&[])
    };
    let [heard, happy] =
        ["neutral:1", "happy:1"].map(|emotion| performed(&by_name(emotion)).unwrap());
    assert!(apart_mm(&heard, &happy) > 0.5);
    assert_eq!(happy, performed(&with_emotion(&[], "happy:1")).unwrap());
}

#[test]
fn an_emotion_that_the_branch_was_not_taught_is_put_on_what_is_said() {
    let of = |emotion: &str| performed(&with_emotion(&[], emotion)).unwrap();
    let (still, half, whole) = (of("neutral"), of("surprised:0.5"), of("surprised:1"));
    let brows = |moved: &Array3<f32>| {
        let heights = moved.slice(ndarray::s![.., 17..27, 1]);
        1e3 * heights.mean().unwrap()
    };
    let [still, half, whole] = [&still, &half, &whole].map(brows);
    assert!(
        half > still + 1.0 && whole > half + 1.0,
        "{still} {half} {whole}"
    );
}

#[test]
fn another_recording_gives_the_emotion() {
    let plain = performed(&request_with(&[])).unwrap();
    let raised = Waveform {
        samples: babble(2.0, 9_000),
    };
    let request = MotionRequest {
        emotion_of: Some(Arc::new(VoiceTrack::checked(&raised).unwrap())),
        ..request_with(&[])
    };
    let other = performed(&request).unwrap();
    assert_eq!(plain.dim(), other.dim());
    assert!(apart_mm(&plain, &other) > 0.01);
    let again = performed(&request).unwrap();
    assert_eq!(other, again);
}

#[test]
fn a_shot_goes_on_from_the_pose_in_which_another_ended() {
    let first = performed(&with_emotion(&[], "happy")).unwrap();
    let end = first.index_axis(ndarray::Axis(0), 30);
    let pose = std::array::from_fn(|n| std::array::from_fn(|axis| end[[n, axis]]));
    let request = MotionRequest {
        starts_from: Some(Pose::from(pose)),
        ..with_emotion(&[], "happy")
    };
    let (rest, on) = (first, performed(&request).unwrap());
    let far = |motion: &Array3<f32>, t: usize| {
        let off = &motion.index_axis(ndarray::Axis(0), t) - &ndarray::arr2(&pose);
        1e3 * off.mapv(|x| x * x).mean().unwrap().sqrt()
    };
    assert!(
        far(&on, 0) < 0.5 * far(&rest, 0),
        "{} {}",
        far(&on, 0),
        far(&rest, 0)
    );
    // At the end the pose at the start has no effect any more.
    let last = rest.len_of(ndarray::Axis(0)) - 1;
    let apart = (&on - &rest)
        .index_axis(ndarray::Axis(0), last)
        .mapv(f32::abs);
    assert!(1e3 * apart.mean().unwrap() < 0.5);
}

/// The largest movement of a landmark from each frame to the next, mm.
fn steps_mm(motion: &Array3<f32>) -> Vec<f32> {
    let frames = motion.outer_iter();
    let pairs = frames.clone().zip(frames.skip(1));
    pairs.map(|(from, to)| largest_mm(&(&to - &from))).collect()
}

fn largest_mm(moved: &Array2<f32>) -> f32 {
    let squares = moved.mapv(|x| x * x).sum_axis(Axis(1));
    1e3 * squares.fold(0.0f32, |most, x| most.max(*x)).sqrt()
}

#[test]
fn five_joined_shots_never_jump() {
    let mut end: Option<Pose> = None;
    for (n, emotion) in ["happy", "angry", "neutral:0", "sad", "happy"]
        .iter()
        .enumerate()
    {
        // Keeps everything that is added to a performance: blinks, accents, effort, closed lips.
        let request = MotionRequest {
            fps: 30.0,
            emotion: EmotionCurve::parse(emotion).unwrap(),
            controls: Controls::default().with("emotion_from", 1.0),
            seed: n as u64,
            starts_from: end,
            ..MotionRequest::default()
        };
        let sound = voice(2.0 + 0.37 * n as f32);
        let performance = ENGINE.perform(&sound, &request, SILENT).unwrap();
        let moved = performance
            .motion
            .landmarks()
            .unwrap()
            .displacements
            .clone();
        let steps = steps_mm(&moved);
        let mut sorted = steps.clone();
        sorted.sort_by(f32::total_cmp);
        let fast = sorted[sorted.len() * 99 / 100];
        if let Some(end) = &end {
            let pose = ndarray::arr2(&end.landmarks);
            let jump = largest_mm(&(&moved.index_axis(Axis(0), 0) - &pose));
            assert!(jump < 1e-3, "shot {n} jumps by {jump} mm");
            assert_eq!(
                performance.life.tongue.row(0).to_vec(),
                end.tongue,
                "shot {n}"
            );
            let begun = steps[..12].iter().fold(0.0f32, |most, x| most.max(*x));
            // The voice is a hum, whose phones come and go at any instant.
            assert!(
                begun <= 1.1 * fast,
                "shot {n} begins with {begun} mm a frame, 99 %: {fast}"
            );
        }
        let last = moved.len_of(Axis(0)) - 1;
        let landmarks = moved.index_axis(Axis(0), last);
        end = Some(Pose::of_frame(landmarks, performance.life.tongue.row(last)));
    }
}

#[test]
fn what_cannot_be_felt_is_told() {
    let refused = |request: &MotionRequest, words: &str| {
        let error = performed(request).unwrap_err();
        assert!(matches!(error, Error::InvalidInput(_)), "{error:?}");
        assert!(error.to_string().contains(words), "{error}");
    };
    let style = MotionRequest {
        style: Some("nobody".into()),
        ..request_with(&[])
    };
    refused(&style, "nobody");
    refused(&request_with(&[("emotion_level", 1.7)]), "emotion_level");
    for silent in [
        voice(0.5),
        Waveform {
            samples: vec![0.0; 32_000],
        },
    ] {
        let error = VoiceTrack::checked(&silent).unwrap_err();
        assert!(matches!(error, Error::Audio(_)), "{error:?}");
    }
    let request = MotionRequest {
        emotion_of: Some(Arc::new(VoiceTrack::of(&voice(1.0)))),
        ..MotionRequest::default()
    };
    let other = engine("freetalk").perform(&voice(1.0), &request, SILENT);
    let message = other.err().unwrap().to_string();
    assert!(
        message.contains("(emoface)") && message.contains("freetalk"),
        "{message}"
    );
}

#[test]
fn what_every_system_hears_of_a_voice_is_what_the_encoder_says() {
    let heard = WhisperEar::open(None).unwrap();
    let heard = heard
        .heard(&VoiceTrack::of(&voice(SECONDS)), None, SILENT)
        .unwrap()
        .curve();
    assert!(
        matches!(&heard, EmotionCurve::Keys(keys) if keys.len() > 3),
        "{heard:?}"
    );
    for system in ["freetalk", "cafe-talk"] {
        let engine = engine(system);
        let motion_under = |emotion: &EmotionCurve| {
            let request = MotionRequest {
                emotion: emotion.clone(),
                ..request_with(&[])
            };
            engine
                .perform(&voice(SECONDS), &request, SILENT)
                .unwrap()
                .motion
        };
        assert_eq!(motion_under(&EmotionCurve::Auto), motion_under(&heard));
        assert_ne!(
            motion_under(&EmotionCurve::Arousal),
            motion_under(&EmotionCurve::Off)
        );
    }
}

/// Displacements `[T, V, 3]` of a motion, or of two mixed.
fn on_head(spread: impl FnOnce(&mut dyn FrameSink) -> Result<SpreadReport>) -> Array3<f32> {
    Collector::collect(spread).unwrap().vertices.displacements
}

#[test]
fn a_mask_mixes_what_is_said_and_what_is_felt_vertex_by_vertex() {
    let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
    let layer = |number: f32| {
        let request = with_emotion(&[("layer", number)], "happy");
        ENGINE.perform(&voice(SECONDS), &request, SILENT).unwrap()
    };
    let [whole, said] = [0.0, 1.0].map(layer);
    assert_eq!(whole.content(&ENGINE, SILENT).unwrap().motion, said.motion);
    let [whole, said] = [whole, said].map(|performance| performance.motion);
    let alone = |motion: &Motion| on_head(|out| ENGINE.spread(&face, motion, out, SILENT));
    let (moved, spoken) = (alone(&whole), alone(&said));
    let vertices = face.mesh.positions.len();
    let mask: Vec<f32> = (0..vertices).map(|v| (v % 5) as f32 / 4.0).collect();
    let rest: Vec<f32> = mask.iter().map(|share| 1.0 - share).collect();
    let mixed = on_head(|out| {
        let parts = [(&said, rest.clone()), (&whole, mask.clone())];
        ENGINE.spread(&face, Movement::Mixed(parts), out, SILENT)
    });
    assert!((&moved - &spoken).iter().any(|x| x.abs() > 1e-3));
    for (v, share) in mask.iter().enumerate() {
        let of = |clip: &Array3<f32>| clip.index_axis(Axis(1), v).to_owned();
        let expected = of(&spoken) * (1.0 - share) + of(&moved) * *share;
        let largest = (of(&mixed) - expected).fold(0.0f32, |most, x| most.max(x.abs()));
        assert!(largest < 1e-6, "vertex {v}: {largest}");
    }
    let short = Movement::Mixed([(&said, vec![0.0; 3]), (&whole, mask.clone())]);
    let refused = Collector::collect(|out| ENGINE.spread(&face, short, out, SILENT));
    let refused = refused.err().unwrap();
    assert!(matches!(refused, Error::ShapeMismatch { .. }), "{refused}");
}

#[test]
fn vertices_follow_the_template_but_for_lips_and_lids() {
    let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
    let files = MODEL.open(None).unwrap();
    let config = EmoFaceConfig::from_json(&files.config).unwrap();
    let weights = Weights::from_bytes(&files.weights).unwrap();
    let template = read_template(&weights, &config).unwrap().unwrap();
    let on_face = TemplateOnFace::new(&face, &template, 1.0).unwrap();
    let shares = on_face.shares();
    let at = |landmark: usize| face.landmarks.vertices[landmark] as usize;
    assert!(
        (36..68).all(|n| shares[at(n)] < 0.02),
        "{:?}",
        shares[at(48)]
    );
    // The cheek lies between the corner of the mouth and the contour.
    for (corner, contour) in [(48, 3), (54, 13)] {
        let ends = [corner, contour].map(|n| face.landmarks.positions[n]);
        let middle: [f32; 3] = std::array::from_fn(|i| 0.5 * (ends[0][i] + ends[1][i]));
        let far = |p: &[f32; 3]| -> f32 { (0..3).map(|i| (p[i] - middle[i]).powi(2)).sum() };
        let places = face.mesh.positions.iter().enumerate();
        let cheek = places
            .min_by(|a, b| far(a.1).total_cmp(&far(b.1)))
            .unwrap()
            .0;
        assert!(shares[cheek] > 0.9, "{}", shares[cheek]);
    }
    // The whole template moves by `by`. Every vertex gets its share of this motion, which replaces
    // the same share of the landmarks' motion there.
    let by = ndarray::arr1(&[1e-3, -2e-3, 5e-4]);
    let vertices = template.mesh.positions.len();
    let motion = Array3::from_shape_fn((2, vertices, 3), |(t, _, axis)| t as f32 * by[axis]);
    let count = face.mesh.positions.len();
    let base = Array3::from_elem((2, count, 3), 7e-4);
    let moved = &base + &on_face.beyond(motion.view(), &base);
    let whole = face.to_canonical.displacements_to_mesh(motion.view());
    for ((t, v, axis), x) in moved.indexed_iter() {
        let expected = shares[v] * whole[[t, 0, axis]] + (1.0 - shares[v]) * 7e-4;
        assert!(
            (x - expected).abs() < 1e-6,
            "{t} {v} {axis}: {x}, {expected}"
        );
    }
    let half = TemplateOnFace::new(&face, &template, 0.5).unwrap();
    assert!(
        half.shares()
            .iter()
            .zip(shares)
            .all(|(a, b)| (2.0 * a - b).abs() < 1e-6)
    );
}

#[test]
fn without_the_template_landmarks_alone_move_a_mesh() {
    let performance = ENGINE
        .perform(&voice(SECONDS), &with_emotion(&[], "happy"), SILENT)
        .unwrap();
    let on = |share: f32| {
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::Positions(head::landmarks())),
            controls: Controls::default().with("template", share),
            ..FaceOptions::default()
        };
        let face = ENGINE.prepare(&head::head(), &options, SILENT).unwrap();
        let moved = on_head(|out| ENGINE.spread(&face, &performance.motion, out, SILENT));
        let clip = performance.motion.landmarks().unwrap().clone();
        let plain = Motion::Landmarks(clip);
        (
            moved,
            on_head(|out| ENGINE.spread(&face, &plain, out, SILENT)),
        )
    };
    let (moved, by_landmarks) = on(0.0);
    assert_eq!(moved, by_landmarks);
    let (moved, by_landmarks) = on(1.0);
    let apart = 1e3 * (&moved - &by_landmarks).fold(0.0f32, |most, x| most.max(x.abs()));
    assert!((0.2..6.0).contains(&apart), "{apart} mm");
}

#[test]
fn emotion_is_believed_at_the_brows_rather_than_at_the_lips() {
    let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
    let performance = ENGINE
        .perform(&voice(SECONDS), &with_emotion(&[], "happy"), SILENT)
        .unwrap();
    let frames = performance.motion.frames();
    let mask_of = |frames| performance.emotion_mask(&ENGINE, &face, frames);
    let mask = mask_of(0..frames).unwrap();
    assert_eq!(mask.dim(), (face.mesh.positions.len(), frames));
    assert!(mask.iter().all(|w| (0.0..=1.0).contains(w)));
    // A frame alone has the same mask as in the whole take, and the mask changes over time.
    assert_eq!(mask_of(7..8).unwrap().column(0), mask.column(7));
    assert_ne!(mask.column(7), mask.column(frames - 1));
    let of_region = |range: std::ops::Range<usize>| {
        let rows = face.landmarks.vertices[range].iter();
        let means: Vec<f32> = rows
            .map(|&v| mask.row(v as usize).mean().unwrap())
            .collect();
        means.iter().sum::<f32>() / means.len() as f32
    };
    let (brows, lips) = (of_region(17..27), of_region(48..68));
    assert!(brows > lips + 0.1, "brows {brows}, lips {lips}");
    let refused = mask_of(0..frames + 1).unwrap_err().to_string();
    assert!(refused.contains("frames: expected some of"), "{refused}");
    let other = engine("freetalk");
    let spoken = other
        .perform(&voice(1.0), &request_with(&[]), SILENT)
        .unwrap();
    let refused = spoken.emotion_mask(&other, &face, 0..1).unwrap_err();
    assert!(refused.to_string().contains("got freetalk"), "{refused}");
}
