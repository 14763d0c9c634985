//! Tests of the command, in one binary so that it is linked once.

mod command;
mod hostile;
mod performance;
mod runs;
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
