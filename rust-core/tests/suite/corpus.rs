//! Files that were fed to the fuzzers or found by them, through what the fuzzers do with them.

use std::{fs, path::Path};

#[path = "../../../fuzz/src/lib.rs"]
mod targets;

/// Hands every file of a folder to a target. Returns how many there were.
fn replay(folder: &str, target: fn(&[u8])) -> usize {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut paths: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    paths.sort();
    for path in &paths {
        // The name of the file that fails is the last one that is shown.
        println!("{}", path.display());
        target(&fs::read(path).unwrap());
    }
    paths.len()
}

#[test]
fn the_corpus_of_the_fuzzers_breaks_nothing() {
    let corpus = [
        ("mesh", targets::mesh as fn(&[u8]), 40),
        ("sound", targets::sound, 10),
        ("arrays", targets::arrays, 15),
        ("text", targets::text, 10),
    ];
    for (name, target, least) in corpus {
        let replayed = replay(&format!("../fuzz/corpus/{name}"), target);
        assert!(replayed >= least, "{name}: {replayed} files");
    }
    replay("tests/fixtures", targets::sound);
}

/// Bytes from one number (SplitMix64).
fn noise(seed: u64, length: usize) -> Vec<u8> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) as u8
    };
    (0..length).map(|_| next()).collect()
}

/// `ANYFACE_MUTATIONS` says how many, from `ANYFACE_MUTATIONS_FROM` on.
#[test]
fn damaged_models_are_refused_or_perform_finite_motion() {
    let number = |name: &str, usual: u64| {
        let set = std::env::var(name).ok();
        set.map_or(usual, |text| text.parse().expect(name))
    };
    let from = number("ANYFACE_MUTATIONS_FROM", 0);
    for seed in from..from + number("ANYFACE_MUTATIONS", 12) {
        println!("{seed}");
        // Model, part, and four bytes for each of one to eight places.
        targets::models(&noise(seed, 2 + 4 * (1 + seed as usize % 8)));
    }
}
