//! What crates.io takes of each crate.

use std::{fs, path::Path};

/// Bytes of a packed crate that crates.io takes.
const CRATES_IO_BYTES: u64 = 10_485_760;

/// Bytes of all files in a folder.
fn bytes(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).unwrap().flatten();
    let sizes = entries.map(|entry| match entry.path() {
        path if path.is_dir() => bytes(&path),
        path => fs::metadata(path).unwrap().len(),
    });
    sizes.sum()
}

/// Packing makes weights smaller, so a crate that fits unpacked fits.
#[test]
fn every_crate_of_weights_fits_unpacked() {
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights");
    let crates: Vec<_> = fs::read_dir(&weights).unwrap().flatten().collect();
    assert!(crates.len() > 1, "{} holds no crates", weights.display());
    for folder in crates {
        let (name, got) = (folder.file_name(), bytes(&folder.path()));
        assert!(
            got < CRATES_IO_BYTES,
            "{name:?}: expected less than {CRATES_IO_BYTES} bytes, got {got}"
        );
    }
}

/// Whoever builds a host compiles weights without running anything.
#[test]
fn no_crate_of_weights_has_a_build_script() {
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights");
    for folder in fs::read_dir(weights).unwrap().flatten() {
        let manifest = fs::read_to_string(folder.path().join("Cargo.toml")).unwrap();
        assert!(!folder.path().join("build.rs").exists());
        assert!(!manifest.contains("build"), "{:?}", folder.file_name());
    }
}
