//! Runs the fuzzer's target on the command lines of its corpus and on random ones.

use std::{fs, path::Path};

#[path = "../../../fuzz/src/options.rs"]
mod target;

#[test]
fn command_lines_of_the_corpus_break_nothing() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/options");
    let mut paths: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    paths.sort();
    assert!(paths.len() >= 30, "{}", paths.len());
    for path in &paths {
        // If a file fails, its name is the last one printed.
        println!("{}", path.display());
        target::options(&fs::read(path).unwrap());
    }
}

/// Random bytes from a seed (SplitMix64).
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

/// `ANYFACE_MUTATIONS` is the number of seeds, and `ANYFACE_MUTATIONS_FROM` the first.
#[test]
fn any_options_are_refused_with_a_message_or_done() {
    let number = |name: &str, usual: u64| {
        let set = std::env::var(name).ok();
        set.map_or(usual, |text| text.parse().expect(name))
    };
    let from = number("ANYFACE_MUTATIONS_FROM", 0);
    for seed in from..from + number("ANYFACE_MUTATIONS", 200) {
        println!("{seed}");
        target::options(&noise(seed, 1 + seed as usize % 40));
    }
}
