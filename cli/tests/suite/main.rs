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
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../rust-core/models")
        .join(name)
}
