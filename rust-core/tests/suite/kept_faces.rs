//! The name of a cached mesh depends on the code that made it, which these tests check. It also
//! depends on the weights, which a test of `BuiltIn` checks.

#[path = "../../build/sources.rs"]
mod sources;

use sources::{SOURCES, digest};
use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

/// A copy of `src`.
fn copy() -> tempfile::TempDir {
    fn copy_folder(from: &Path, to: &Path) {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(from).unwrap() {
            let entry = entry.unwrap();
            let to = to.join(entry.file_name());
            if entry.path().is_dir() {
                copy_folder(&entry.path(), &to)
            } else {
                fs::copy(entry.path(), to).unwrap();
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    copy_folder(&from, &folder.path().join("src"));
    folder
}

/// The first file of a folder, or the file itself.
fn first_file(path: PathBuf) -> PathBuf {
    if path.is_dir() {
        first_file(fs::read_dir(path).unwrap().next().unwrap().unwrap().path())
    } else {
        path
    }
}

/// Whether a change in `file` changes the name.
fn matters(root: &Path, file: &Path) -> bool {
    let before = digest(root).unwrap();
    let mut file = fs::File::options().append(true).open(file).unwrap();
    file.write_all(b"\n").unwrap();
    digest(root).unwrap() != before
}

#[test]
fn faces_are_kept_when_speech_or_text_change() {
    let root = copy();
    for name in ["src/speech/ear.rs", "src/text/mod.rs", "src/lib.rs"] {
        assert!(!matters(root.path(), &root.path().join(name)), "{name}");
    }
}

#[test]
fn faces_are_made_anew_when_their_code_changes() {
    let root = copy();
    for source in SOURCES {
        let file = first_file(root.path().join(source));
        assert!(matters(root.path(), &file), "{}", file.display());
    }
    let added = root.path().join("src/deform/added.rs");
    let before = digest(root.path()).unwrap();
    fs::write(&added, "").unwrap();
    assert_ne!(digest(root.path()).unwrap(), before);
}

#[test]
fn missing_source_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = digest(folder.path()).unwrap_err().to_string();
    assert!(error.contains(SOURCES[0]), "{error}");
}
