//! FaceTalk through the engine: speech to the landmarks of a head that is a field.

use std::sync::LazyLock;

use anyface::{
    CachePolicy, Engine, EngineOptions, Error, MotionRequest, Result, audio::Waveform,
    conditions::Controls, motion::Motion, progress::SILENT,
};
use ndarray::{Array3, s};

use crate::performance::babble;

const SECONDS: f32 = 3.0;

static ENGINE: LazyLock<Engine> = LazyLock::new(|| {
    Engine::new(EngineOptions {
        system: Some("facetalk".into()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap()
});

/// A request with some controls, and nothing that chance adds but the seed.
fn asked(seed: u64, controls: &[(&str, f32)]) -> MotionRequest {
    let still = ["blinks_per_minute", "brow_accents", "gaze", "head_motion"];
    let all = still.iter().map(|name| (*name, 0.0));
    let all = all.chain(controls.iter().copied());
    MotionRequest {
        fps: 25.0,
        seed,
        controls: all.fold(Controls::default(), |all, (name, value)| {
            all.with(name, value)
        }),
        ..MotionRequest::default()
    }
}

fn said(samples: Vec<f32>, request: &MotionRequest) -> Result<Array3<f32>> {
    match ENGINE
        .perform(&Waveform { samples }, request, SILENT)?
        .motion
    {
        Motion::Landmarks(clip) => Ok(clip.displacements),
        other => panic!("expected landmarks, got {}", other.kind()),
    }
}

fn voice() -> Vec<f32> {
    babble(SECONDS, 16_000)
}

/// Deviation of the distance of the inner lips over time, mm.
fn amplitude(motion: &Array3<f32>) -> f32 {
    let gap = &motion.slice(s![.., 62, 1]) - &motion.slice(s![.., 66, 1]);
    1e3 * gap.std(0.0)
}

#[test]
fn a_voice_moves_the_mouth_and_silence_hardly_does() {
    let spoken = said(voice(), &asked(0, &[])).unwrap();
    assert_eq!(spoken.dim(), (75, 68, 3));
    let silent = said(vec![0.0; voice().len()], &asked(0, &[])).unwrap();
    let (voiced, still) = (amplitude(&spoken), amplitude(&silent));
    assert!(voiced > 1.0 && voiced > 1.5 * still, "{voiced} {still}");
    let bridge = spoken.slice(s![.., 27, ..]).mapv(f32::abs);
    assert!(
        bridge.iter().all(|x| *x < 1e-3),
        "the bridge of the nose moves"
    );
}

#[test]
fn the_same_seed_says_it_the_same_way_and_another_one_otherwise() {
    let first = said(voice(), &asked(3, &[])).unwrap();
    assert_eq!(first, said(voice(), &asked(3, &[])).unwrap());
    assert_ne!(first, said(voice(), &asked(4, &[])).unwrap());
}

#[test]
fn vividness_and_guidance_open_the_mouth_wider() {
    for (name, low, high) in [("vividness", 0.7, 1.3), ("speech_guidance", 1.0, 3.0)] {
        let [less, more] = [low, high]
            .map(|value| amplitude(&said(voice(), &asked(0, &[(name, value)])).unwrap()));
        assert!(more > less, "{name}: {less} {more}");
    }
}

#[test]
fn styles_and_values_that_it_does_not_know_are_told() {
    let refused = |request: &MotionRequest, words: &str| {
        let error = said(voice(), request).unwrap_err();
        assert!(matches!(error, Error::InvalidInput(_)), "{error:?}");
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(&asked(0, &[("vividness", 2.0)]), "vividness");
    let style = MotionRequest {
        style: Some("nobody".into()),
        ..asked(0, &[])
    };
    refused(&style, "nobody");
}
