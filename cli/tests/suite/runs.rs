//! Compares runs of the command with the numbers that they gave before. A change of design must change no
//! number.
//!
//! If the numbers are meant to change, `ANYFACE_REFRESH_GOLDENS=1 cargo test -p anyface-cli --test suite
//! runs` writes `tests/goldens/runs.json` anew. The instruction sets of processors differ in the last
//! bits, hence the tolerance.

use std::{collections::BTreeMap, env, fs, path::Path, process::Command};

use anyface::{
    mesh::Mesh,
    output::{read_landmark_motion, read_rig, read_vertex_motion},
};

use crate::{model, voice::babble};

/// How much a number may differ, as a share of the largest number of its array.
const TOLERANCE: f32 = 1e-5;
/// How many numbers of an array are kept, spread over all of it.
const SAMPLES: usize = 48;

/// Name of the file that a run writes, and its command line; `HEAD` stands for the default head with
/// its landmarks.
const RUNS: [(&str, &str); 10] = [
    ("plain.npz", "animate HEAD --audio v.wav"),
    (
        "angry.pc2",
        "animate HEAD --audio v.wav --emotion angry:1.2 --fps 24 --seed 5",
    ),
    (
        "shaped.npz",
        "animate HEAD --audio v.wav --emotion auto --articulation 1.4 --jaw 0.6 --rounding 1.5 --width 0.8 --tongue 0.5 \
         --smoothing 0.03 --asymmetry 0.5",
    ),
    (
        "keyed.mdd",
        "animate HEAD --audio v.wav --emotion-keys 0:neutral,0.5:happy:0.9,1:sad:0.5 --upper-face 1.5 \
         --blinks 60 --brow-accents 2",
    ),
    (
        "steps.npz",
        "motion --audio v.wav --emotion surprised:1 --fps 60 --steps 4 --seed 9",
    ),
    (
        "causal.npz",
        "motion --audio v.wav --causal --emotion happy:0.5",
    ),
    (
        "recorded.npz",
        "motion --audio v.wav --emotion off --style grid_s1",
    ),
    ("rig.npz", "rig HEAD"),
    (
        "deformed.npz",
        "deform HEAD --motion steps.npz --learned 0 --part teeth_lower=still",
    ),
    (
        "paper.npz",
        "animate HEAD --audio short.wav --decoder paper",
    ),
];

/// Writes a sound into `folder`.
fn write_sound(folder: &Path, name: &str, seconds: f32) {
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: 16_000,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    let mut wav = hound::WavWriter::create(folder.join(name), spec).unwrap();
    for sample in babble(seconds, 16_000) {
        wav.write_sample(sample).unwrap();
    }
    wav.finalize().unwrap();
}

/// Every number that a run wrote.
fn numbers(path: &Path, line: &str, mesh: &Mesh) -> Vec<f32> {
    match line.split_whitespace().next() {
        Some("rig") => read_rig(path).unwrap().deltas.into_raw_vec_and_offset().0,
        Some("motion") => read_landmark_motion(path)
            .unwrap()
            .displacements
            .iter()
            .copied()
            .collect(),
        _ => read_vertex_motion(path, mesh)
            .unwrap()
            .displacements
            .iter()
            .copied()
            .collect(),
    }
}

/// Sums up a run for its golden: the count, the largest magnitude, and `SAMPLES` numbers spread over all.
fn sample(numbers: &[f32]) -> Vec<f32> {
    let largest = numbers.iter().fold(0.0f32, |most, x| most.max(x.abs()));
    let some = (0..SAMPLES).map(|i| numbers[(2 * i + 1) * numbers.len() / (2 * SAMPLES)]);
    [numbers.len() as f32, largest]
        .into_iter()
        .chain(some)
        .collect()
}

#[test]
fn ten_runs_give_the_numbers_that_they_gave() {
    let folder = tempfile::tempdir().unwrap();
    write_sound(folder.path(), "v.wav", 1.5);
    write_sound(folder.path(), "short.wav", 0.1);
    let head = model("default_head");
    let mesh = Mesh::read(head.join("head.obj")).unwrap();
    let words = format!(
        "--mesh {} --landmarks {} --no-cache",
        head.join("head.obj").display(),
        head.join("landmarks.json").display()
    );
    let program = env::var("ANYFACE_COMMAND").unwrap_or(env!("CARGO_BIN_EXE_anyface").into());
    let mut samples = BTreeMap::new();
    for (name, line) in RUNS {
        let filled = line.replace("HEAD", &words);
        let arguments = filled.split_whitespace().map(|word| {
            if word.starts_with("0:neutral,") {
                word.replace(',', " ")
            } else {
                word.to_owned()
            }
        });
        let output = Command::new(&program)
            .current_dir(folder.path())
            .args(arguments)
            .args(["--out", name])
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{line}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        samples.insert(
            name,
            sample(&numbers(&folder.path().join(name), line, &mesh)),
        );
    }
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/goldens/runs.json");
    if env::var_os("ANYFACE_REFRESH_GOLDENS").is_some() {
        fs::write(&golden, serde_json::to_string(&samples).unwrap() + "\n").unwrap();
    }
    let text = fs::read_to_string(golden).unwrap();
    let expected: BTreeMap<String, Vec<f32>> = serde_json::from_str(&text).unwrap();
    assert_eq!(expected.len(), RUNS.len());
    for (name, numbers) in &expected {
        let limit = TOLERANCE * numbers[1];
        for (i, (got, want)) in samples[name.as_str()].iter().zip(numbers).enumerate() {
            assert!(
                (got - want).abs() <= limit,
                "{name} {i}: expected {want}, got {got}"
            );
        }
    }
}
