//! Emotions through the whole engine, with the built-in weights.

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest,
    audio::Waveform,
    conditions::{EMOTIONS, EmotionCurve},
    job::SILENT,
    motion::{Expressions, PerformanceControls},
};
use ndarray::{Array3, Axis, s};

use crate::{head, voice::babble};

fn voice() -> Waveform {
    Waveform {
        samples: babble(4.0, 16_000),
    }
}

fn request_with(emotion: &str) -> MotionRequest {
    MotionRequest {
        emotion: EmotionCurve::parse(emotion).unwrap(),
        controls: PerformanceControls::as_sampled().into(),
        ..MotionRequest::default()
    }
}

fn landmarks(engine: &Engine, request: &MotionRequest) -> Array3<f32> {
    let performance = engine.perform(&voice(), request, SILENT).unwrap();
    performance
        .motion
        .landmarks()
        .unwrap()
        .displacements
        .clone()
}

#[test]
fn what_is_asked_is_what_is_seen() {
    let engine = head::engine();
    let neutral = landmarks(&engine, &request_with("neutral:0"));
    let table = Expressions::open(None).unwrap();
    for (e, emotion) in EMOTIONS.iter().enumerate().skip(1) {
        let mut one = [0.0; EMOTIONS.len()];
        one[e] = 1.0;
        let target = table.whole(&one).slice_move(s![17..48, ..]);
        let shown = |strength: f32| {
            let displaced = landmarks(&engine, &request_with(&format!("{emotion}:{strength}")));
            let moved = (displaced - &neutral).mean_axis(Axis(0)).unwrap();
            (&moved.slice(s![17..48, ..]) * &target).sum() / (&target * &target).sum()
        };
        let (full, most) = (shown(1.0), shown(1.5));
        assert!((0.95..1.12).contains(&full), "{emotion}: {full}");
        // In anger and surprise, brows and wide lids cannot go further, so these emotions gain
        // less.
        assert!((1.25..1.5 * 1.12).contains(&most), "{emotion}: {most}");
    }
}

#[test]
fn neutral_at_any_strength_is_no_expression() {
    let engine = head::engine();
    let none = landmarks(&engine, &request_with("neutral:0"));
    assert_eq!(landmarks(&engine, &request_with("neutral:1")), none);
    let off = landmarks(&engine, &request_with("off"));
    let speaking = |motion: &Array3<f32>| motion.slice(s![.., 48.., ..]).to_owned();
    assert_eq!(speaking(&off), speaking(&none));
}

#[test]
fn another_emotion_needs_no_new_sampling() {
    let engine = head::engine();
    let first = engine
        .perform(&voice(), &request_with("happy:0.4"), SILENT)
        .unwrap();
    let again = first.again(&engine, &request_with("angry:1.3")).unwrap();
    let anew = landmarks(&engine, &request_with("angry:1.3"));
    assert_eq!(again.motion.landmarks().unwrap().displacements, anew);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let with = |threads: usize| {
        let options = EngineOptions {
            threads: Some(threads),
            cache: CachePolicy::Off,
            ..EngineOptions::default()
        };
        let request = MotionRequest {
            emotion: EmotionCurve::parse("disgusted:1.2").unwrap(),
            ..MotionRequest::default()
        };
        landmarks(&Engine::new(options).unwrap(), &request)
    };
    assert_eq!(with(1), with(3));
}
