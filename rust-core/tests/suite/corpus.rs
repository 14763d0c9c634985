//! Runs the fuzzers' targets on files that were fed to the fuzzers or found by them.

use std::{fs, ops::Range, path::Path};

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
        // The last name that is shown is that of the file that fails.
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
        ("redo", targets::redo, 20),
        ("heads", targets::heads, 20),
    ];
    for (name, target, least) in corpus {
        let replayed = replay(&format!("../fuzz/corpus/{name}"), target);
        assert!(replayed >= least, "{name}: {replayed} files");
    }
    replay("tests/fixtures", targets::sound);
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

/// Seeds of the mutations. `ANYFACE_MUTATIONS` sets how many, `ANYFACE_MUTATIONS_FROM` the first.
fn mutations(usual: u64) -> Range<u64> {
    let number = |name: &str, usual: u64| {
        let set = std::env::var(name).ok();
        set.map_or(usual, |text| text.parse().expect(name))
    };
    let from = number("ANYFACE_MUTATIONS_FROM", 0);
    from..from + number("ANYFACE_MUTATIONS", usual)
}

/// Damages each file in one to six places: changes a byte, cuts off the end or repeats some bytes.
#[test]
fn damaged_files_of_every_kind_break_nothing() {
    let targets = [
        ("mesh", targets::mesh as fn(&[u8])),
        ("sound", targets::sound),
        ("arrays", targets::arrays),
        ("text", targets::text),
        ("redo", targets::redo),
        ("heads", targets::heads),
    ];
    for (name, target) in targets {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../fuzz/corpus")
            .join(name);
        let mut paths: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().path())
            .collect();
        paths.sort();
        for seed in mutations(20) {
            let path = &paths[seed as usize % paths.len()];
            println!("{name} {seed} {}", path.display());
            target(&damaged(fs::read(path).unwrap(), seed));
        }
    }
}

fn damaged(mut bytes: Vec<u8>, seed: u64) -> Vec<u8> {
    let noise = noise(seed, 64);
    for change in noise[8..8 + 8 * (1 + usize::from(noise[0] % 6))].chunks_exact(8) {
        if bytes.is_empty() {
            break;
        }
        let at = u32::from_le_bytes([change[0], change[1], change[2], 0]) as usize % bytes.len();
        match change[4] % 8 {
            0 => bytes.truncate(at),
            1 => bytes.extend_from_within(at..bytes.len().min(at + 64)),
            2 => bytes[at] = [0, 0x7f, 0x80, 0xff][usize::from(change[5] % 4)],
            3 => bytes[at] = bytes[at].wrapping_add(1),
            _ => bytes[at] = change[5],
        }
    }
    bytes
}

#[test]
fn damaged_models_are_refused_or_perform_finite_motion() {
    for seed in mutations(12) {
        println!("{seed}");
        // Model, part, and four bytes for each of one to eight places.
        targets::models(&noise(seed, 2 + 4 * (1 + seed as usize % 8)));
    }
}
