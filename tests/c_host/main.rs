//! C and C++ programs against the C interface, linked both ways.

mod callers;
mod examples;
mod install;
mod interface;

use std::path::{Path, PathBuf};

use anyface_tests::scene::Scene;

/// Folder for the files of one test; empty at its start.
fn workspace(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("c_host")
        .join(test);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("the folder for tests can be written");
    folder
}

fn scene(folder: &Path) -> Scene {
    Scene::write(folder, 0.6).expect("the scene can be written")
}
