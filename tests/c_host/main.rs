//! C and C++ programs against the C interface, linked both ways.

mod callers;
mod examples;
mod install;
mod interface;

use std::{
    ops::Deref,
    path::{Path, PathBuf},
};

use anyface_tests::scene::Scene;

/// Folder for the files of one test. It stays only if the test fails, because each program that
/// links the static library takes 95 MB.
struct Workspace(PathBuf);

impl Deref for Workspace {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl AsRef<Path> for Workspace {
    fn as_ref(&self) -> &Path {
        &self.0
    }
}

impl Drop for Workspace {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }
}

/// An empty folder for one test.
fn workspace(test: &str) -> Workspace {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("c_host")
        .join(test);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("the folder for tests can be written");
    Workspace(folder)
}

fn scene(folder: &Path) -> Scene {
    Scene::write(folder, 0.6).expect("the scene can be written")
}
