//! Cafe-Talk through the engine: events, lips that meet, controls on weights.

use std::sync::LazyLock;

use anyface::{
    Engine, EngineOptions, Error, MotionRequest, Performance,
    audio::Waveform,
    conditions::{Controls, EmotionCurve, Event},
    job::SILENT,
    mesh::PartChoices,
    motion::{FaceModes, LipGaps, Motion, WeightClip},
    spread::Collector,
};
use ndarray::{Axis, s};

use crate::{head, voice::babble};

const FPS: f64 = 25.0;

static ENGINE: LazyLock<Engine> = LazyLock::new(|| {
    Engine::new(EngineOptions {
        system: Some("cafe-talk".into()),
        cache: anyface::CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap()
});

fn voice(seconds: f32) -> Waveform {
    Waveform {
        samples: babble(seconds, 16_000),
    }
}

/// A request with events in the form of the command line, and with nothing that chance adds.
pub fn request_with(events: &[&str]) -> MotionRequest {
    let still = [
        "blinks_per_minute",
        "brow_accents",
        "gaze",
        "head_motion",
        "variety",
    ];
    let controls = still.iter().fold(Controls::default(), |controls, name| {
        controls.with(name, 0.0)
    });
    MotionRequest {
        fps: FPS,
        controls,
        events: events
            .iter()
            .map(|event| Event::parse(event).unwrap())
            .collect(),
        ..MotionRequest::default()
    }
}

fn performed(seconds: f32, request: &MotionRequest) -> Performance {
    ENGINE.perform(&voice(seconds), request, SILENT).unwrap()
}

/// A part of a take has the closures of its own frames, not those of the first frames of the sound.
#[test]
fn a_part_of_a_take_moves_a_mesh_as_the_whole_does() {
    let request = MotionRequest {
        closures: Some(vec![[1.4, 1.7]]),
        ..request_with(&["1-2:26"])
    };
    let performance = performed(3.0, &request);
    let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
    let spread = |motion: &Motion| {
        let clip = Collector::collect(|sink| ENGINE.spread(&face, motion, sink, SILENT));
        clip.unwrap().vertices.displacements
    };
    let whole = spread(&performance.motion);
    let together = &weights(&performance).together;
    assert!(
        together[30..60].iter().any(|share| *share > 0.5),
        "{together:?}"
    );
    let part = spread(&performance.motion.frames_of(30..60));
    assert_eq!(part, whole.slice(s![30..60, .., ..]));
}

fn weights(performance: &Performance) -> WeightClip {
    match &performance.motion {
        Motion::Weights(clip) => clip.clone(),
        other => panic!("expected weights, got {}", other.kind()),
    }
}

/// Mean weight of a shape between two times in seconds.
fn mean(clip: &WeightClip, name: &str, from_s: f64, to_s: f64) -> f32 {
    let frames = (from_s * FPS) as usize..(to_s * FPS) as usize;
    let column = clip.column(name).unwrap();
    clip.weights.slice(s![frames, column]).mean().unwrap()
}

#[test]
fn a_wink_shuts_the_eye_that_it_names_in_its_slot() {
    let plain = weights(&performed(4.0, &request_with(&[])));
    let winking = weights(&performed(4.0, &request_with(&["1.6-2.4:45L"])));
    let more = |name: &str, from_s: f64, to_s: f64| {
        mean(&winking, name, from_s, to_s) - mean(&plain, name, from_s, to_s)
    };
    assert!(
        more("eyeBlinkLeft", 1.8, 2.2) > 0.3,
        "{}",
        more("eyeBlinkLeft", 1.8, 2.2)
    );
    assert!(more("eyeBlinkRight", 1.8, 2.2) < 0.1);
    for beyond in [(0.0, 1.2), (2.8, 4.0)] {
        assert!(more("eyeBlinkLeft", beyond.0, beyond.1).abs() < 0.02);
    }
}

#[test]
fn units_that_no_network_has_learned_come_in_their_slots() {
    let plain = performed(3.0, &request_with(&[]));
    let moved = performed(3.0, &request_with(&["1.2-1.8:kiss!", "1.2-1.8:look left"]));
    let pucker = |performance: &Performance, from_s, to_s| {
        mean(&weights(performance), "mouthPucker", from_s, to_s)
    };
    assert!(pucker(&moved, 1.3, 1.7) > 0.9);
    // The lips take 0.6 s to come.
    assert!((pucker(&moved, 0.0, 0.5) - pucker(&plain, 0.0, 0.5)).abs() < 1e-6);
    let yaw = |second: f64| moved.life.gaze[[(second * FPS) as usize, 0, 0]];
    assert!(yaw(1.5) > 0.35 && yaw(0.5).abs() < 0.01, "{}", yaw(1.5));
}

#[test]
fn a_stronger_event_shows_more() {
    let smile = |strength: &str| {
        let clip = weights(&performed(
            4.0,
            &request_with(&[&format!("1.5-2.5:12:{strength}")]),
        ));
        mean(&clip, "mouthSmileLeft", 1.7, 2.3) + mean(&clip, "mouthSmileRight", 1.7, 2.3)
    };
    let shown = ["0", "0.5", "1", "1.5"].map(smile);
    assert!(shown.windows(2).all(|pair| pair[1] > pair[0]), "{shown:?}");
    assert_eq!(shown[0], {
        let plain = weights(&performed(4.0, &request_with(&[])));
        mean(&plain, "mouthSmileLeft", 1.7, 2.3) + mean(&plain, "mouthSmileRight", 1.7, 2.3)
    });
}

#[test]
fn calibration_sets_the_peak_and_without_it_the_model_does() {
    let raised = |calibrate: f32, events: &[&str]| {
        let mut request = request_with(events);
        request.controls.set("calibrate", calibrate);
        weights(&performed(4.0, &request))
    };
    let peak = |clip: &WeightClip| {
        let column = clip.weights.column(clip.column("browInnerUp").unwrap());
        column.iter().copied().fold(0.0f32, f32::max)
    };
    let (on, off) = (0.0, 1.0);
    for strength in [0.5, 1.0] {
        let event = format!("1.5-2.5:1:{strength}");
        let [calibrated, sampled] = [on, off].map(|value| peak(&raised(value, &[&event])));
        assert!((calibrated - strength).abs() < 0.02, "{calibrated}");
        assert!((sampled - strength).abs() > 0.02, "{sampled}");
    }
    assert_eq!(raised(on, &[]), raised(off, &[]));
}

#[test]
fn windows_that_no_event_touches_keep_their_bits() {
    let windows = ENGINE.description().windows.unwrap();
    let seconds = 3.0 * windows.frames as f32 / windows.fps as f32;
    let plain = weights(&performed(seconds, &request_with(&[])));
    let smiling = weights(&performed(seconds, &request_with(&["1-2:12"])));
    let all = windows.of(plain.weights.nrows());
    let beyond = all[0].end..plain.weights.nrows();
    assert!(beyond.len() > 100);
    let rows = |clip: &WeightClip| clip.weights.slice(s![beyond.clone(), ..]).to_owned();
    assert_eq!(rows(&plain), rows(&smiling));
    assert_ne!(plain.weights, smiling.weights);
}

#[test]
fn lips_meet_where_they_are_told_to_unless_an_event_is_over_the_speech() {
    let mut request = request_with(&[]);
    request.closures = Some(vec![[1.0, 1.08], [2.0, 2.08]]);
    request.events = vec![Event::parse("1.9-2.2:26:1!").unwrap()];
    let clip = weights(&performed(3.0, &request));
    let gaps = LipGaps::of_mean_face(&FaceModes::open(None).unwrap(), &clip.names).unwrap();
    let opening = |frame: usize| gaps.largest(clip.weights.row(frame));
    assert!(opening(26) < 0.0, "{}", opening(26));
    assert_eq!((clip.together[26], clip.together[51]), (1.0, 0.0));
    assert!(opening(51) > 0.0);
}

#[test]
fn lips_of_the_head_itself_meet() {
    let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
    let mut request = request_with(&[]);
    request.closures = Some(vec![[1.0, 1.08]]);
    let motion = performed(2.0, &request).motion;
    let clip = Collector::collect(|sink| ENGINE.spread(&face, &motion, sink, SILENT)).unwrap();
    let moved = clip.landmark_displacements.index_axis(Axis(0), 26);
    let metres = face.metres_per_unit() as f32;
    for (upper, lower) in [(61, 67), (62, 66), (63, 65)] {
        let parted = (moved[[upper, 1]] - moved[[lower, 1]]) * metres;
        assert!(parted < 0.1e-3, "{upper}: {parted}");
    }
}

#[test]
fn blinks_shut_both_eyes_and_speech_alone_moves_no_brow() {
    let mut request = request_with(&[]);
    request.controls.set("blinks_per_minute", 60.0);
    let blinking = weights(&performed(6.0, &request));
    for name in ["eyeBlinkLeft", "eyeBlinkRight"] {
        let column = blinking.weights.column(blinking.column(name).unwrap());
        let most = column.iter().copied().fold(0.0f32, f32::max);
        assert!((0.9..1.2).contains(&most), "{name}: {most}");
    }
    request.emotion = EmotionCurve::Off;
    let still = weights(&performed(6.0, &request));
    for name in ["eyeBlinkLeft", "browInnerUp", "noseSneerRight"] {
        assert_eq!(mean(&still, name, 0.0, 6.0), 0.0);
    }
}

#[test]
fn articulation_scales_speech_and_lips_that_met_still_meet() {
    let mut request = request_with(&[]);
    request.closures = Some(vec![[1.0, 1.08]]);
    let plain = ENGINE.perform(&voice(3.0), &request, SILENT).unwrap();
    request.controls.set("articulation", 1.5);
    let more = weights(&plain.again(&ENGINE, &request).unwrap());
    assert!(mean(&more, "jawOpen", 0.0, 3.0) > 1.2 * mean(&weights(&plain), "jawOpen", 0.0, 3.0));
    let gaps = LipGaps::of_mean_face(&FaceModes::open(None).unwrap(), &more.names).unwrap();
    assert!(gaps.largest(more.weights.row(26)) < 0.0);
}

#[test]
fn another_seed_is_another_take_in_which_lips_still_meet() {
    let modes = FaceModes::open(None).unwrap();
    let take = |seed: u64| {
        let mut request = request_with(&[]);
        request.controls.set("variety", 1.0);
        request.closures = Some(vec![[1.0, 1.08]]);
        request.seed = seed;
        weights(&performed(4.0, &request))
    };
    let (one, other) = (take(1), take(2));
    assert_eq!(one, take(1));
    let gaps = LipGaps::of_mean_face(&modes, &one.names).unwrap();
    for clip in [&one, &other] {
        assert!(gaps.largest(clip.weights.row(26)) < 0.0);
        assert!(clip.weights.iter().all(|weight| *weight >= 0.0));
    }
    let gap = |clip: &WeightClip| {
        let moved = clip.landmarks(&modes).unwrap().displacements;
        &moved.slice(s![.., 62, 1]) - &moved.slice(s![.., 66, 1])
    };
    let (a, b) = (gap(&one), gap(&other));
    let apart_mm = 1e3 * (&a - &b).mapv(f32::abs).mean().unwrap();
    assert!((0.1..1.5).contains(&apart_mm), "{apart_mm} mm");
    let centred = |x: &ndarray::Array1<f32>| x - x.mean().unwrap();
    let (a, b) = (centred(&a), centred(&b));
    let r = a.dot(&b) / (a.dot(&a) * b.dot(&b)).sqrt();
    assert!(r > 0.95, "r {r}");
}

#[test]
fn what_cannot_be_asked_is_refused_by_name() {
    let check_refused = |engine: &Engine, request: &MotionRequest, words: &str| {
        let error = engine.perform(&voice(1.0), request, SILENT).err().unwrap();
        assert!(
            matches!(error, Error::InvalidInput(_)) && error.to_string().contains(words),
            "{error}"
        );
    };
    check_refused(&head::engine(), &request_with(&["0-1:12"]), "cafe-talk");
    let mut request = request_with(&[]);
    request.controls.set("breath", 1.0);
    check_refused(&ENGINE, &request, "breath");
    request = request_with(&[]);
    request.style = Some("nobody".into());
    check_refused(&ENGINE, &request, "nobody");
    request = request_with(&["0-1:12"]);
    request.events[0].strength = f32::NAN;
    check_refused(&ENGINE, &request, "strength");
}
