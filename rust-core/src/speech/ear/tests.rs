//! Tests of the ear.

use super::*;
use crate::{
    job::SILENT,
    nn::golden::{Golden, distance},
};

const GOLDEN: &str = "ear_debug";

/// The files of a model in the golden, under `prefix`.
fn files(golden: &Golden, prefix: &str) -> ModelFiles {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    golden.write_arrays(&format!("{prefix}."), &path, |named| named);
    ModelFiles {
        weights: std::fs::read(path).unwrap(),
        config: golden.metadata(&format!("{prefix}_config")).into(),
    }
}

fn both(golden: &Golden) -> (ModelFiles, ModelFiles) {
    (files(golden, "trunk"), files(golden, "body"))
}

fn load((trunk, body): &(ModelFiles, ModelFiles)) -> Result<Ear> {
    let trunk = WhisperTrunk::load(&Weights::from_bytes(&trunk.weights)?, &trunk.config)?;
    Ear::load(Arc::new(trunk), body)
}

fn debug_ear() -> (Ear, Golden) {
    let golden = Golden::open(GOLDEN);
    (load(&both(&golden)).unwrap(), golden)
}

/// A voice-like sound of this length.
fn sound(samples: usize) -> Waveform {
    let sample = |i: usize| (i as f32 * 0.08).sin() * (i as f32 * 0.0015).sin() * 0.3;
    Waveform {
        samples: (0..samples).map(sample).collect(),
    }
}

#[test]
fn mel_and_features_are_those_of_training() {
    let (ear, golden) = debug_ear();
    let samples = golden.values("input");
    let error = distance(&ear_mel(&samples), &golden.values("mel"));
    assert!(error < 1e-4, "mel: {error}");
    let track = ear.encode(&Waveform { samples }, SILENT).unwrap();
    assert_eq!(track.features.dim(), golden.matrix("output").dim());
    let error = distance(&track.features, &golden.values("output"));
    assert!(error < 1e-4, "output: {error}");
}

#[test]
fn the_body_gives_the_same_span_by_span_as_at_once() {
    let (ear, _) = debug_ear();
    // Spans of 12 s: three, the second of which ends where no output frame begins.
    let mel = ear_mel(&sound(16_000 * 31 + 500).samples);
    let spans = ear.forward(&mel, SILENT).unwrap();
    let mut outputs: Vec<Vec<Array2<f32>>> = Vec::new();
    let taps = &ear.body.config().taps;
    let take = |_: std::ops::Range<usize>, span: Vec<Array2<f32>>| outputs.push(span);
    ear.trunk.hear(&mel, taps, SILENT, take).unwrap();
    assert_eq!(outputs.len(), 3);
    let joint: Vec<Array2<f32>> = (0..taps.len())
        .map(|tap| {
            let parts: Vec<_> = outputs.iter().map(|span| span[tap].view()).collect();
            concatenate(Axis(0), &parts).unwrap()
        })
        .collect();
    let whole = ear.body.forward(&ear.body.enter(&joint));
    assert_eq!(spans.dim(), whole.dim());
    assert!(distance(&spans, whole.as_slice().unwrap()) < 1e-5);
}

#[test]
fn the_thread_count_changes_no_bit() {
    let (ear, _) = debug_ear();
    let sound = sound(16_000 * 14);
    let features = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| ear.encode(&sound, SILENT).unwrap().features)
    };
    assert_eq!(features(1), features(3));
}

#[test]
fn loud_and_quiet_copies_of_a_sound_have_the_same_features() {
    let (ear, golden) = debug_ear();
    let encoded = |gain: f32| {
        let samples = golden.values("input").iter().map(|x| gain * x).collect();
        ear.encode(&Waveform { samples }, SILENT).unwrap().features
    };
    let (loud, quiet) = (encoded(2.0), encoded(0.7));
    assert!(distance(&loud, quiet.as_slice().unwrap()) < 1e-3);
}

#[test]
fn short_sounds_and_silence_give_finite_features() {
    let (ear, _) = debug_ear();
    for samples in [
        vec![0.3; 1],
        vec![0.0; 320],
        sound(399).samples,
        sound(400).samples,
    ] {
        let track = ear.encode(&Waveform { samples }, SILENT).unwrap();
        assert_eq!(track.features.dim(), (1, ear.channels()));
        assert!(track.features.iter().all(|x| x.is_finite()));
        assert_eq!((track.rate_hz, track.first_s), (25.0, 0.0));
    }
    let nothing = Waveform { samples: vec![] };
    let refused = ear.encode(&nothing, SILENT).unwrap_err().to_string();
    assert!(refused.contains("got no samples"), "{refused}");
}

#[test]
fn damaged_weights_are_refused() {
    let golden = Golden::open(GOLDEN);
    let refused = |change: &dyn Fn(&mut ModelFiles, &mut ModelFiles)| {
        let (mut trunk, mut body) = both(&golden);
        change(&mut trunk, &mut body);
        match load(&(trunk, body)) {
            Err(Error::Weights(message)) => message,
            other => panic!("expected Weights, got {:?}", other.map(|_| ())),
        }
    };
    let half = |files: &mut ModelFiles| files.weights.truncate(files.weights.len() / 2);
    let replace = |files: &mut ModelFiles, from: &str, to: &str| {
        assert!(files.config.contains(from), "{}", files.config);
        files.config = files.config.replace(from, to).into();
    };
    refused(&|trunk, _| half(trunk));
    refused(&|_, body| half(body));
    refused(&|_, body| body.weights.clear());
    refused(&|trunk, _| trunk.config = "{".into());
    for (from, to, words) in [
        ("\"bands\": 80", "\"bands\": 64", "80 bands, got"),
        ("\"heads\": 2", "\"heads\": 3", "divides 16 channels, got 3"),
        (
            "\"heads\": 2",
            "\"heads\": 0",
            "heads: expected 1 to 256, got 0",
        ),
        (
            "\"width\": 16",
            "\"width\": 3",
            "width: expected an even number",
        ),
        ("\"layers\": 2", "\"layers\": 3", "layers.2"),
    ] {
        let said = refused(&|trunk, _| replace(trunk, from, to));
        assert!(said.contains(words), "{said}");
    }
    for (from, to, words) in [
        (
            "\"model\": \"ear\"",
            "\"model\": \"eye\"",
            "expected ear and 25 Hz, got eye",
        ),
        (
            "\"rate_hz\": 25.0",
            "\"rate_hz\": 50.0",
            "got ear and 50 Hz",
        ),
        (
            "\"taps\": [1, 2]",
            "\"taps\": [2, 1]",
            "taps: expected ascending numbers up to 2",
        ),
        (
            "\"taps\": [1, 2]",
            "\"taps\": [2, 3]",
            "up to 2, got [2, 3]",
        ),
        (
            "\"taps\": [1, 2]",
            "\"taps\": []",
            "deviation: expected [0, 16]",
        ),
        (
            "\"width\": 16",
            "\"width\": 32",
            "deviation: expected [2, 32], got [2, 16]",
        ),
        ("\"channels\": 16", "\"channels\": 8", "expected [8"),
    ] {
        let said = refused(&|_, body| replace(body, from, to));
        assert!(said.contains(words), "{said}");
    }
}
