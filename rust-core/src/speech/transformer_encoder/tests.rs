//! Compares the encoders with Hugging Face's numbers, and reads damaged folders.

use super::*;
use crate::{
    job::SILENT,
    nn::golden::{Golden, Named, damage, distance, path_of, seeds},
    speech::from_folder,
};

fn encoder(golden: &Golden, layer: Option<usize>) -> TransformerEncoder {
    let config = EncoderConfig::from_json(&golden.metadata("config")).unwrap();
    TransformerEncoder::new(config, &golden.weights(), false, layer).unwrap()
}

/// Every hidden state of a sound, beginning with the one before the first layer, and the output.
fn states(encoder: &TransformerEncoder, samples: &[f32]) -> (Vec<Array2<f32>>, Array2<f32>) {
    let mut hidden = Vec::new();
    let x = encoder.features.forward(samples);
    let output = encoder.run(x, encoder.layers.len(), &mut |state| {
        hidden.push(state.to_owned());
    });
    (hidden, output)
}

fn check(name: &str) {
    let golden = Golden::open(name);
    let (hidden, output) = states(&encoder(&golden, None), &golden.values("input"));
    assert_eq!(hidden.len(), 3);
    for (index, state) in hidden.iter().enumerate() {
        let error = distance(state, &golden.values(&format!("hidden.{index}")));
        assert!(error < 1e-4, "hidden {index}: {error}");
    }
    let error = distance(&output, &golden.values("output"));
    assert!(error < 1e-4, "output: {error}");
}

#[test]
fn hubert_matches_in_every_hidden_state() {
    check("hubert_tiny");
}

#[test]
fn wav2vec2_matches_in_every_hidden_state() {
    check("wav2vec2_tiny");
}

#[test]
fn stable_wav2vec2_matches_in_every_hidden_state() {
    check("wav2vec2_stable_tiny");
}

#[test]
fn chosen_layer_is_that_hidden_state_at_50_hz() {
    let golden = Golden::open("wav2vec2_stable_tiny");
    let waveform = Waveform {
        samples: golden.values("input"),
    };
    for (layer, name) in [
        (Some(1), "hidden.1"),
        (Some(2), "hidden.2"),
        (None, "output"),
    ] {
        let track = encoder(&golden, layer).encode(&waveform, SILENT).unwrap();
        assert_eq!((track.rate_hz, track.features.dim()), (50.0, (50, 32)));
        assert_eq!(track.first_s, 0.0125);
        assert!(
            distance(&track.features, &golden.values(name)) < 1e-4,
            "{name}"
        );
    }
}

/// Writes a golden file as a Hugging Face folder. `edit` may change names, shapes and values.
fn folder(golden: &Golden, edit: impl Fn(Named) -> Named) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    golden.write_arrays("weights.", &folder.path().join("model.safetensors"), edit);
    std::fs::write(folder.path().join("config.json"), golden.metadata("config")).unwrap();
    folder
}

#[test]
fn folder_with_a_head_and_old_names_gives_the_same_numbers() {
    let golden = Golden::open("hubert_tiny");
    let folder = folder(&golden, |(name, shape, values)| {
        let name = name
            .replace("parametrizations.weight.original0", "weight_g")
            .replace("parametrizations.weight.original1", "weight_v");
        (format!("hubert.{name}"), shape, values)
    });
    let preprocessor = r#"{"do_normalize": false, "sampling_rate": 16000}"#;
    std::fs::write(folder.path().join("preprocessor_config.json"), preprocessor).unwrap();
    let encoder = from_folder(folder.path(), None, None).unwrap();
    let waveform = Waveform {
        samples: golden.values("input"),
    };
    let track = encoder.encode(&waveform, SILENT).unwrap();
    assert!(distance(&track.features, &golden.values("output")) < 1e-4);
}

#[test]
#[cfg(feature = "checkpoints")]
fn folder_of_pytorch_gives_the_same_numbers() {
    let golden = Golden::open("hubert_tiny");
    let folder = folder(&golden, |all| all);
    let raw = r#"{"do_normalize": false, "sampling_rate": 16000}"#;
    std::fs::write(folder.path().join("preprocessor_config.json"), raw).unwrap();
    std::fs::remove_file(folder.path().join("model.safetensors")).unwrap();
    let pytorch = folder.path().join("pytorch_model.bin");
    std::fs::copy(path_of("hubert_tiny.bin"), pytorch).unwrap();
    let encoder = from_folder(folder.path(), None, None).unwrap();
    let samples = golden.values("input");
    let track = encoder.encode(&Waveform { samples }, SILENT).unwrap();
    assert!(distance(&track.features, &golden.values("output")) < 1e-2);
}

#[test]
fn input_is_normalised_where_nothing_says_otherwise() {
    let golden = Golden::open("hubert_tiny");
    let folder = folder(&golden, |all| all);
    let hubert = from_folder(folder.path(), None, None).unwrap();
    let quiet: Vec<f32> = golden
        .values("input")
        .iter()
        .map(|x| 0.3 + 0.1 * x)
        .collect();
    let track = hubert.encode(&Waveform { samples: quiet }, SILENT).unwrap();
    let input = unit_variance(&golden.values("input"));
    let (_, expected) = states(&encoder(&golden, None), &input);
    assert!(distance(&track.features, &expected) < 1e-3);
}

#[test]
fn damaged_folders_are_weights_errors() {
    let golden = Golden::open("hubert_tiny");
    let whole = folder(&golden, |all| all);
    let path = whole.path().join("model.safetensors");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let message = |folder: &tempfile::TempDir| match from_folder(folder.path(), None, None).err() {
        Some(Error::Weights(message)) => message,
        other => panic!("{other:?}"),
    };
    assert!(message(&whole).contains("whole safetensors file"));

    let cut = folder(&golden, |(name, mut shape, mut values)| {
        if name == "encoder.layers.1.attention.k_proj.weight" {
            shape[0] = 31;
            values.truncate(31 * 32);
        }
        (name, shape, values)
    });
    let text = message(&cut);
    assert!(
        text.contains("k_proj.weight: expected [32, 32], got [31, 32]"),
        "{text}"
    );

    std::fs::write(cut.path().join("config.json"), "{\"model_type\": \"bert\"}").unwrap();
    assert!(message(&cut).contains("bert"));
}

#[test]
fn missing_folder_is_an_io_error_and_short_sound_an_audio_error() {
    let missing = from_folder(Path::new("/nonexistent"), None, None);
    assert!(matches!(missing.err(), Some(Error::Io { .. })));
    let golden = Golden::open("hubert_tiny");
    let short = Waveform {
        samples: vec![0.1; 320],
    };
    let error = encoder(&golden, None).encode(&short, SILENT).unwrap_err();
    assert_eq!(
        error.to_string(),
        "audio: expected at least 400 samples at 16 kHz, got 320"
    );
}

#[test]
fn long_sound_is_encoded_in_spans_of_bounded_length() {
    let golden = Golden::open("wav2vec2_stable_tiny");
    let encoder = encoder(&golden, Some(0));
    let second = golden.values("input");
    let samples: Vec<f32> = second.iter().cycle().take(16_000 * 40).copied().collect();
    let whole = states(&encoder, &samples).0.swap_remove(0);
    let track = encoder.encode(&Waveform { samples }, SILENT).unwrap();
    // The state before the first layer depends only on nearby frames, so spans change nothing.
    assert_eq!(track.features.dim(), whole.dim());
    assert!(distance(&track.features, &whole) < 1e-4);
}

#[test]
fn damaged_folders_are_refused_or_encode() {
    for (name, seed) in ["hubert_tiny", "wav2vec2_stable_tiny"]
        .into_iter()
        .flat_map(|name| seeds().map(move |seed| (name, seed)))
    {
        for file in ["config.json", "model.safetensors"] {
            let golden = Golden::open(name);
            let folder = folder(&golden, |all| all);
            damage(&folder.path().join(file), seed);
            let encoder = from_folder(folder.path(), None, None);
            let samples = golden.values("input");
            // The features may hold any numbers: later code checks the motion made from them.
            let _ = encoder.map(|encoder| encoder.encode(&Waveform { samples }, SILENT));
        }
    }
}

#[test]
fn the_rate_may_be_changed_before_the_transformer() {
    let resampled = Golden::open("resampled_speech");
    let fps: f64 = resampled.metadata("fps").parse().unwrap();
    for name in ["hubert_tiny", "wav2vec2_tiny", "wav2vec2_stable_tiny"] {
        let golden = Golden::open(name);
        let encoder = encoder(&golden, None).resampled(Some(fps));
        let samples = golden.values("input");
        let track = encoder.encode(&Waveform { samples }, SILENT).unwrap();
        assert_eq!((track.rate_hz, track.first_s), (fps, 0.0));
        let error = distance(&track.features, &resampled.values(name));
        assert!(error < 1e-4, "{name}: {error}");
    }
}

#[test]
fn long_sound_at_another_rate_is_encoded_in_spans_too() {
    let golden = Golden::open("wav2vec2_stable_tiny");
    let second = golden.values("input");
    let samples: Vec<f32> = second.iter().cycle().take(16_000 * 70).copied().collect();
    let heard = encoder(&golden, Some(0));
    let whole = heard.convolved(&samples, 0..heard.heard_frames(samples.len()));
    let (rate_hz, first_s) = heard.heard_instants();
    let track = FeatureTrack {
        features: whole,
        rate_hz,
        first_s,
    };
    let mut expected = Array2::zeros((0, 0));
    let brought = at_motion_frames(&track, 70 * 25, 25.0);
    heard.run(brought, 0, &mut |state| expected = state.to_owned());
    let encoder = heard.resampled(Some(25.0));
    let track = encoder.encode(&Waveform { samples }, SILENT).unwrap();
    assert_eq!(track.features.dim(), (70 * 25, 32));
    assert!(distance(&track.features, &expected) < 1e-4);
}
