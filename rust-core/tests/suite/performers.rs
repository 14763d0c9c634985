//! Performers through the engine: learned from captured faces and from corrected takes.

use std::{path::PathBuf, sync::Arc};

use anyface::{
    CapturedTake, Engine, MotionRequest, audio::Waveform, conditions::Controls, job::SILENT,
    motion::LandmarkClip,
};
use ndarray::{Array1, s};

use crate::{engine, voice::intoned};

/// A request with some controls, and with nothing that chance adds beside the speech.
fn request_with(controls: &[(&str, f32)]) -> MotionRequest {
    let still = ["blinks_per_minute", "brow_accents", "gaze", "head_motion"];
    let all = still.iter().map(|name| (*name, 0.0));
    let all = all.chain(controls.iter().copied());
    MotionRequest {
        fps: 25.0,
        controls: all.fold(Controls::default(), |all, (name, value)| {
            all.with(name, value)
        }),
        ..MotionRequest::default()
    }
}

fn spoken(engine: &Engine, sound: &Waveform, request: &MotionRequest) -> LandmarkClip {
    let performance = engine.perform(sound, request, SILENT).unwrap();
    engine.landmarks_of(&performance.motion).unwrap()
}

/// The distance of the corners of the mouth over time, `[T]`, less that at rest, mm.
fn widths(clip: &LandmarkClip) -> Array1<f32> {
    let corner = |number: usize| clip.displacements.slice(s![.., number, 0]);
    (&corner(54) - &corner(48)) * 1e3
}

#[test]
fn every_system_shows_its_own_performers_and_no_others() {
    let sound = Waveform {
        samples: intoned(8.0, 16_000),
    };
    let mut earlier = None;
    for system in ["freetalk", "cafe-talk", "emoface", "facetalk"] {
        let engine = engine(system);
        let plain = spoken(&engine, &sound, &request_with(&[]));
        let person = request_with(&[("width", 2.0), ("jaw", 1.6)]);
        let take = CapturedTake {
            name: "person".into(),
            sound: sound.clone(),
            motion: spoken(&engine, &sound, &person),
            generated: None,
            frame_weights: None,
        };
        let performer = Arc::new(
            engine
                .learn_performer(std::slice::from_ref(&take), SILENT)
                .unwrap(),
        );
        let with = |performer: &Arc<_>, strength: f32| MotionRequest {
            performer: Some(Arc::clone(performer)),
            performer_strength: strength,
            ..request_with(&[])
        };
        let shown = spoken(&engine, &sound, &with(&performer, 1.0));
        let [plain_mm, person_mm, shown_mm] =
            [&plain, &take.motion, &shown].map(|clip| widths(clip).std(0.0));
        println!(
            "{system}: width {plain_mm:.2} mm, person {person_mm:.2} mm, shown {shown_mm:.2} mm"
        );
        assert!(
            shown_mm > plain_mm + 0.3 * (person_mm - plain_mm),
            "{system}: {plain_mm} {person_mm} {shown_mm}"
        );
        assert_eq!(spoken(&engine, &sound, &with(&performer, 0.0)), plain);
        if let Some(other) = earlier.replace(performer) {
            let error = engine.perform(&sound, &with(&other, 1.0), SILENT);
            let error = error.err().expect("another system's performer").to_string();
            assert!(error.contains(&format!("learned with {system}")), "{error}");
        }
    }
}

#[test]
fn a_stream_shows_a_performer_that_its_whole_look_ahead_hears() {
    let engine = engine("freetalk");
    let sound = Waveform {
        samples: intoned(8.0, 16_000),
    };
    let person = request_with(&[("width", 2.0), ("jaw", 1.6)]);
    let take = CapturedTake {
        name: "person".into(),
        sound: sound.clone(),
        motion: spoken(&engine, &sound, &person),
        generated: None,
        frame_weights: None,
    };
    let performer = Arc::new(engine.learn_performer(&[take], SILENT).unwrap());
    assert!(!performer.card().live_scores.is_empty());
    let shown = |strength: Option<f32>| {
        let request = MotionRequest {
            performer: strength.map(|_| Arc::clone(&performer)),
            performer_strength: strength.unwrap_or(1.0),
            fps: 25.0,
            ..MotionRequest::default()
        };
        engine.causal_motion(&sound, &request, SILENT).unwrap()
    };
    let plain = shown(None);
    assert_eq!(shown(Some(0.0)), plain);
    let [without_mm, with_mm] = [plain, shown(Some(1.0))].map(|clip| widths(&clip).std(0.0));
    println!("live: width {without_mm:.2} mm, with the performer {with_mm:.2} mm");
    assert!(with_mm > 1.2 * without_mm, "{without_mm} {with_mm}");

    let mut sooner = engine.stream().unwrap();
    sooner.look_ahead(0.07).unwrap();
    let error = sooner.set_performer(Some(Arc::clone(&performer)), 1.0);
    assert!(error.unwrap_err().to_string().contains("look-ahead"));
}

/// A clip of `../shared`, and where it has an "oo": its begin and end, seconds.
type Line = (&'static str, &'static [[f64; 2]]);

/// "He looked like one who had passed through an uncomfortable hour or two."
const CORRECTED: Line = (
    "arctic_b0048_1592700282",
    &[[1.075, 1.185], [1.835, 1.905], [3.445, 3.685]],
);

fn sound_of((name, _): Line) -> Waveform {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let shared = std::env::var_os("ANYFACE_SHARED").map_or(beside, Into::into);
    let path = shared.join(format!("data/speech/kathleen_en/{name}.ogg"));
    Waveform::from_file(&path).unwrap()
}

/// How much each frame `[T]` is part of an "oo", 0 to 1, with soft ends.
fn oo(clip: &LandmarkClip, (_, spans): Line) -> Array1<f32> {
    let share = |time_s: f64| {
        let of = |[start, end]: &[f64; 2]| {
            let half = (0.5 * (end - start)).max(0.05);
            let off = (time_s - 0.5 * (start + end)).abs();
            (1.5 - 0.75 * off / half).clamp(0.0, 1.0)
        };
        spans.iter().map(of).fold(0.0, f64::max) as f32
    };
    (0..clip.displacements.dim().0)
        .map(|t| share(t as f64 / clip.fps))
        .collect()
}

/// The mean of `values` `[T]` over frames of an "oo", and over frames far from one.
fn on_and_off(values: &Array1<f32>, oo: &Array1<f32>) -> [f32; 2] {
    [(0.9..=1.0), (0.0..=0.0)].map(|range: std::ops::RangeInclusive<f32>| {
        let frames = values
            .iter()
            .zip(oo)
            .filter(|(_, share)| range.contains(share));
        let values: Vec<f32> = frames.map(|(value, _)| *value).collect();
        values.iter().sum::<f32>() / values.len() as f32
    })
}

#[test]
#[ignore = "needs ../shared"]
fn an_oo_that_was_corrected_in_three_words_is_said_so_in_others() {
    let engine = engine("freetalk");
    let sound = sound_of(CORRECTED);
    let generated = spoken(&engine, &sound, &request_with(&[]));
    let share = oo(&generated, CORRECTED);
    let mut motion = generated.clone();
    for (mut face, share) in motion.displacements.outer_iter_mut().zip(&share) {
        // The corners come in by 3 mm each, and the lips go out by 2 mm.
        face[[48, 0]] += 0.003 * share;
        face[[54, 0]] -= 0.003 * share;
        face.slice_mut(s![48.., 2])
            .mapv_inplace(|z| z + 0.002 * share);
    }
    let learned = |count: f32| {
        let take = CapturedTake {
            name: "corrected".into(),
            sound: sound.clone(),
            motion: motion.clone(),
            generated: Some(generated.clone()),
            frame_weights: Some(share.mapv(|share| if share > 0.0 { count } else { 1.0 })),
        };
        Arc::new(engine.learn_performer(&[take], SILENT).unwrap())
    };
    let lines: [Line; 4] = [
        // "But how are you going to do it."
        ("arctic_b0343_1592531303", &[[0.695, 0.725], [1.365, 1.535]]),
        // "I can't argue with you, and you know that."
        (
            "arctic_a0386_1592708146",
            &[[0.865, 0.925], [1.215, 1.395], [1.825, 1.915]],
        ),
        // "Very few people knew of the existence of this law."
        ("arctic_b0469_1592527437", &[[0.525, 0.595], [1.085, 1.345]]),
        // "He'll knock you off a few sticks in no time."
        ("arctic_a0334_1592709286", &[[0.585, 0.655], [1.095, 1.155]]),
    ];
    let moved = |count: f32| {
        let performer = learned(count);
        let mut means = [[0.0; 2]; 2];
        for line in lines {
            let sound = sound_of(line);
            let plain = spoken(&engine, &sound, &request_with(&[]));
            let request = MotionRequest {
                performer: Some(Arc::clone(&performer)),
                ..request_with(&[])
            };
            let shown = spoken(&engine, &sound, &request);
            let share = oo(&plain, line);
            let out = |clip: &LandmarkClip| {
                let lips = clip.displacements.slice(s![.., 48.., 2]);
                lips.mean_axis(ndarray::Axis(1)).unwrap() * 1e3
            };
            let changes = [widths(&shown) - widths(&plain), out(&shown) - out(&plain)];
            for (mean, change) in means.iter_mut().zip(&changes) {
                for (sum, x) in mean.iter_mut().zip(on_and_off(change, &share)) {
                    *sum += x / lines.len() as f32;
                }
            }
        }
        println!("frames count {count}: width and lips forward, on oo and off it, mm: {means:?}");
        means
    };
    let (alike, counted) = (moved(1.0), moved(4.0));
    let [[width, width_off], [out, out_off]] = counted;
    assert!(width < -3.0 && width_off.abs() < 1.5, "{counted:?}");
    assert!(out > 1.0 && out_off.abs() < 0.5, "{counted:?}");
    // Corrected frames that count more are followed more closely.
    assert!(width < alike[0][0], "{alike:?} {counted:?}");
}
