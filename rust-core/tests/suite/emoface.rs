//! EmoFace through the engine: what is said and how it is felt, apart and together.

use std::{
    path::PathBuf,
    sync::{Arc, LazyLock},
};

use anyface::{
    CachePolicy, Engine, EngineOptions, Error, MotionRequest, Result,
    audio::Waveform,
    conditions::{Controls, EmotionCurve},
    motion::Motion,
    progress::SILENT,
    speech::{FeelingEncoder, FeltVoice},
};
use ndarray::Array3;

use crate::performance::babble;

const SECONDS: f32 = 2.0;

static ENGINE: LazyLock<Engine> = LazyLock::new(|| engine("emoface"));

fn engine(system: &str) -> Engine {
    Engine::new(EngineOptions {
        system: Some(system.into()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap()
}

fn voice(seconds: f32) -> Waveform {
    Waveform {
        samples: babble(seconds, 16_000),
    }
}

/// A request with some controls, and nothing that chance adds.
fn asked(controls: &[(&str, f32)]) -> MotionRequest {
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

fn felt(controls: &[(&str, f32)], emotion: &str) -> MotionRequest {
    MotionRequest {
        emotion: EmotionCurve::parse(emotion).unwrap(),
        ..asked(&[&[("feeling_from", 1.0)], controls].concat())
    }
}

fn performed(request: &MotionRequest) -> Result<Array3<f32>> {
    let made = ENGINE.perform(&voice(SECONDS), request, SILENT)?.motion;
    match made {
        Motion::Landmarks(clip) => Ok(clip.displacements),
        other => panic!("expected landmarks, got {}", other.kind()),
    }
}

/// Mean distance of landmarks, mm.
fn apart_mm(one: &Array3<f32>, other: &Array3<f32>) -> f32 {
    let squares = (one - other).mapv(|x| x * x);
    let distance = squares.sum_axis(ndarray::Axis(2)).mapv(f32::sqrt);
    1e3 * distance.mean().unwrap()
}

#[test]
fn what_is_said_does_not_hear_what_is_felt() {
    let layer = |number: f32, emotion| performed(&felt(&[("layer", number)], emotion)).unwrap();
    assert_eq!(layer(1.0, "happy"), layer(1.0, "angry"));
    for number in [0.0, 2.0] {
        let between = apart_mm(&layer(number, "happy"), &layer(number, "angry"));
        assert!(between > 0.3, "{number} {between}");
    }
}

#[test]
fn more_of_a_feeling_moves_the_face_further_from_rest() {
    let at = |level: f32| performed(&felt(&[("feeling_level", level)], "happy")).unwrap();
    let none = at(0.0);
    let steps: Vec<f32> = [0.5, 1.0, 1.5].map(|l| apart_mm(&at(l), &none)).to_vec();
    assert!(steps.windows(2).all(|pair| pair[0] < pair[1]), "{steps:?}");
}

#[test]
fn another_recording_gives_the_feeling() {
    let own = performed(&asked(&[])).unwrap();
    let raised = Waveform {
        samples: babble(2.0, 9_000),
    };
    let request = MotionRequest {
        felt_as: Some(Arc::new(FeltVoice::checked(&raised).unwrap())),
        ..asked(&[])
    };
    let other = performed(&request).unwrap();
    assert_eq!(own.dim(), other.dim());
    assert!(apart_mm(&own, &other) > 0.01);
    let again = performed(&request).unwrap();
    assert_eq!(other, again);
}

#[test]
fn a_shot_goes_on_from_the_pose_in_which_another_ended() {
    let first = performed(&felt(&[], "happy")).unwrap();
    let end = first.index_axis(ndarray::Axis(0), 30);
    let pose = std::array::from_fn(|n| std::array::from_fn(|axis| end[[n, axis]]));
    let request = MotionRequest {
        starts_from: Some(pose),
        ..felt(&[], "happy")
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
    // What came before is forgotten.
    let last = rest.len_of(ndarray::Axis(0)) - 1;
    let apart = (&on - &rest)
        .index_axis(ndarray::Axis(0), last)
        .mapv(f32::abs);
    assert!(1e3 * apart.mean().unwrap() < 0.5);
}

#[test]
fn what_cannot_be_felt_is_told() {
    let refused = |request: &MotionRequest, words: &str| {
        let error = performed(request).unwrap_err();
        assert!(matches!(error, Error::InvalidInput(_)), "{error:?}");
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(&felt(&[], "suspicious"), "neutral, angry, happy");
    let style = MotionRequest {
        style: Some("nobody".into()),
        ..asked(&[])
    };
    refused(&style, "nobody");
    refused(&asked(&[("feeling_level", 1.7)]), "feeling_level");
    for silent in [
        voice(0.5),
        Waveform {
            samples: vec![0.0; 32_000],
        },
    ] {
        let error = FeltVoice::checked(&silent).unwrap_err();
        assert!(matches!(error, Error::Audio(_)), "{error:?}");
    }
    let request = MotionRequest {
        felt_as: Some(Arc::new(FeltVoice::of(&voice(1.0)))),
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
    let heard = FeelingEncoder::open(None).unwrap();
    let heard = heard.emotion(&FeltVoice::of(&voice(SECONDS)));
    assert!(
        matches!(&heard, EmotionCurve::Keys(keys) if keys.len() > 3),
        "{heard:?}"
    );
    for system in ["freetalk", "cafe-talk"] {
        let engine = engine(system);
        let made = |emotion: &EmotionCurve| {
            let request = MotionRequest {
                emotion: emotion.clone(),
                ..asked(&[])
            };
            engine
                .perform(&voice(SECONDS), &request, SILENT)
                .unwrap()
                .motion
        };
        assert_eq!(made(&EmotionCurve::Auto), made(&heard));
        assert_ne!(made(&EmotionCurve::Arousal), made(&EmotionCurve::Off));
    }
}

/// Recordings of the data folder whose names a filter wants, every `step`-th.
fn recordings(source: &str, step: usize, wanted: fn(&str) -> bool) -> Vec<Waveform> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let shared = std::env::var_os("ANYFACE_SHARED").map_or(beside, Into::into);
    let files = std::fs::read_dir(shared.join("data/speech").join(source)).unwrap();
    let mut files: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|kind| kind == "ogg"));
    files.retain(|path| wanted(path.file_stem().unwrap().to_str().unwrap()));
    files.sort();
    let chosen = files.iter().skip(1).step_by(step);
    chosen
        .map(|path| Waveform::from_file(path).unwrap())
        .collect()
}

/// Mean intensity of what is heard.
fn intensity(encoder: &FeelingEncoder, sound: &Waveform) -> f32 {
    let heard = encoder.emotion(&FeltVoice::of(sound));
    let frames = (sound.duration_s() * 10.0) as usize;
    heard.sample(frames, 10.0).column(15).mean().unwrap()
}

#[test]
#[ignore = "needs ../shared"]
fn readers_stay_neutral_and_angry_actors_do_not() {
    let encoder = FeelingEncoder::open(None).unwrap();
    let mut still = Vec::new();
    for source in ["kathleen_en", "kerstin_de", "nathalie_nl"] {
        let sounds = recordings(source, 11, |_| true);
        let heard = sounds
            .iter()
            .take(14)
            .map(|sound| intensity(&encoder, sound));
        still.extend(heard.map(|intensity| intensity < 0.05));
    }
    let neutral = still.iter().filter(|is_still| **is_still).count();
    assert!(
        still.len() >= 40 && 40 * neutral >= 38 * still.len(),
        "{neutral} of {}",
        still.len()
    );
    // Two actors of whom nothing was taught.
    let angry = recordings("emodb_de", 2, |name| {
        (name.starts_with("09") || name.starts_with("12")) && name[5..].starts_with('W')
    });
    let shown: f32 = angry.iter().map(|sound| intensity(&encoder, sound)).sum();
    assert!(
        shown / angry.len() as f32 > 0.5,
        "{shown} of {}",
        angry.len()
    );
}
