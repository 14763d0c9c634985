//! Tests of the command, in one binary so that it is linked once.

mod batch;
mod command;
mod derived;
mod hostile;
mod live;
#[cfg(target_os = "linux")]
mod microphone;
mod options;
mod performance;
mod runs;
mod targets;
#[path = "../../../rust-core/tests/suite/voice.rs"]
mod voice;

use std::path::{Path, PathBuf};

/// The folder of a built-in model.
fn model(name: &str) -> PathBuf {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights");
    let mut folders = std::fs::read_dir(crates)
        .unwrap()
        .map(|entry| entry.unwrap().path().join(name));
    folders.find(|folder| folder.is_dir()).unwrap()
}

/// A folder with these samples in `a.wav`.
fn folder_with_sound(samples: &[f32], rate_hz: u32) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: rate_hz,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    let mut wav = hound::WavWriter::create(folder.path().join("a.wav"), spec).unwrap();
    for sample in samples {
        wav.write_sample(*sample).unwrap();
    }
    wav.finalize().unwrap();
    folder
}
