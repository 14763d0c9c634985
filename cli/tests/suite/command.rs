//! The `anyface` command from outside: exit codes, errors, and that failures leave no file.

use std::{
    collections::{BTreeMap, BTreeSet, HashSet},
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use tempfile::TempDir;

use crate::{folder_with_sound, voice::babble};

/// Exit codes that scripts rely on.
const USAGE: i32 = 2;
const INVALID_INPUT: i32 = 3;
const AUDIO: i32 = 4;
const MESH: i32 = 5;
const FACE_NOT_FOUND: i32 = 6;
const IO: i32 = 8;

fn anyface(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_anyface"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Expects a failure with this exit code and a message with `words`. It must leave the folder unchanged.
fn refused(folder: &TempDir, arguments: &[&str], code: i32, words: &str) {
    let before = names(folder.path());
    let output = anyface(folder.path(), arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    assert!(message.contains(words), "{arguments:?}: {message}");
    assert_eq!(names(folder.path()), before, "{arguments:?} left files");
}

fn names(folder: &Path) -> Vec<PathBuf> {
    let mut names: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    names.sort();
    names
}

fn hum(seconds: f32) -> Vec<f32> {
    (0..(seconds * 16_000.0) as usize)
        .map(|i| (i as f32 * 0.08).sin() * (i as f32 * 0.0015).sin() * 0.5)
        .collect()
}

const MOTION: [&str; 5] = ["motion", "--audio", "a.wav", "--out", "o.npz"];

#[test]
fn usage_mistakes_exit_with_2() {
    let folder = tempfile::tempdir().unwrap();
    refused(&folder, &["dance"], USAGE, "dance");
    refused(&folder, &["motion", "--out", "o.npz"], USAGE, "--audio");
    refused(
        &folder,
        &["landmarks", "--mesh", "m", "--out", "l", "--up", "w"],
        USAGE,
        "expected x, -x",
    );
}

#[test]
fn causal_motion_is_written_like_any_other() {
    let folder = folder_with_sound(&hum(1.01), 16_000);
    let output = anyface(
        folder.path(),
        &[&MOTION[..], &["--causal", "--fps", "25"]].concat(),
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    let motion = anyface::output::read_landmark_motion(&folder.path().join("o.npz")).unwrap();
    assert_eq!(
        (motion.displacements.dim(), motion.fps),
        ((26, 68, 3), Some(25.0))
    );
    let style = [&MOTION[..], &["--causal", "--style", "any"]].concat();
    let refusal = anyface(folder.path(), &style);
    assert_eq!(refusal.status.code(), Some(USAGE));
}

#[test]
fn requests_out_of_range_exit_with_3_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let with = |extra: &[&'static str]| [&MOTION[..], extra].concat();
    for (extra, words) in [
        (["--fps", "0"], "fps: expected 1 to 240, got 0"),
        (["--fps", "nan"], "fps: expected 1 to 240"),
        (["--emotion", "joyful:1"], "expected one of neutral, happy"),
        (["--emotion", "happy:9"], "sum of at most"),
        (["--threads", "0"], "threads: expected 1 to 256, got 0"),
        (
            ["--articulation", "3"],
            "articulation: expected 0 to 2, got 3",
        ),
        (["--jaw", "3"], "jaw: expected 0 to 2, got 3"),
        (["--emotion-keys", "happy"], "expected seconds:emotion"),
    ] {
        refused(&folder, &with(&extra), INVALID_INPUT, words);
    }
    let arguments = ["motion", "--audio", "a.wav", "--out", "o.pc2"];
    refused(&folder, &arguments, INVALID_INPUT, ".npz");
    let arguments = [
        "animate", "--mesh", "m.obj", "--audio", "a.wav", "--out", "o.abc",
    ];
    refused(
        &folder,
        &arguments,
        INVALID_INPUT,
        ".npz, .pc2, .mdd, .glb, .vrm, .usda or .vrma",
    );
}

#[test]
fn surfaces_over_time_are_refused_where_they_cannot_be_and_say_what_they_would_take() {
    let folder = folder_with_sound(&hum(0.5), 16_000);
    let head = crate::model("default_head").join("head.obj");
    let head = head.to_str().unwrap();
    let arguments = |system: &'static str, cells: &'static str, out: &'static str| {
        let start = ["animate", "--mesh", head, "--audio", "a.wav", "--no-cache"];
        let end = ["--system", system, "--surface", cells, "--out", out];
        [&start[..], &end].concat()
    };
    let mine = folder.path().join("mine");
    fs::create_dir(&mine).unwrap();
    fs::write(mine.join("a.ply"), "ply").unwrap();
    for (system, cells, out, words) in [
        ("facetalk", "16", "frames", "expected 32 to 512 cells"),
        ("facetalk", "1024", "frames", "would take about 2500 MB"),
        ("facetalk", "64", "o.npz", "expected a folder"),
        ("facetalk", "64", "mine", "1 files, such as a.ply"),
        ("freetalk", "64", "frames", "(facetalk), got freetalk"),
    ] {
        refused(
            &folder,
            &arguments(system, cells, out),
            INVALID_INPUT,
            words,
        );
    }
    let both = [
        &arguments("facetalk", "64", "frames")[..],
        &["--open-mouth"],
    ]
    .concat();
    refused(&folder, &both, USAGE, "--open-mouth");
    let moved = |system: &'static str| {
        let start = ["deform", "--mesh", head, "--motion", "m.npz", "--no-cache"];
        let end = ["--system", system, "--surface", "64", "--out", "frames"];
        [&start[..], &end].concat()
    };
    let both = [&moved("facetalk")[..], &["--attention", "a.npz"]].concat();
    refused(&folder, &both, USAGE, "--attention");
    let output = anyface(
        folder.path(),
        &["motion", "--audio", "a.wav", "--out", "m.npz"],
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    refused(
        &folder,
        &moved("freetalk"),
        INVALID_INPUT,
        "(facetalk), got freetalk",
    );
    assert_eq!(names(&mine).len(), 1);
}

#[test]
fn sounds_that_cannot_be_used_exit_with_4() {
    let mut broken = hum(0.5);
    broken[77] = f32::NAN;
    broken[99] = f32::INFINITY;
    let folder = folder_with_sound(&broken, 16_000);
    refused(
        &folder,
        &MOTION,
        AUDIO,
        "got 2 of 8000 that are NaN or infinite, the first at 77",
    );
    let folder = folder_with_sound(&[], 16_000);
    refused(&folder, &MOTION, AUDIO, "no samples");
    let folder = folder_with_sound(&hum(0.1), 2_000);
    refused(&folder, &MOTION, AUDIO, "got 2000");
    fs::write(folder.path().join("a.wav"), b"").unwrap();
    refused(&folder, &MOTION, AUDIO, "empty");
    fs::write(folder.path().join("a.wav"), [9; 3000]).unwrap();
    refused(&folder, &MOTION, AUDIO, "expected WAV, MP3");
}

#[test]
fn missing_files_exit_with_8_and_their_name() {
    let folder = tempfile::tempdir().unwrap();
    refused(&folder, &MOTION, IO, "a.wav");
    let arguments = ["landmarks", "--mesh", "m.obj", "--out", "l.json"];
    refused(&folder, &arguments, IO, "m.obj");
    let arguments = [
        "deform", "--mesh", "m.obj", "--motion", "l.npz", "--out", "o.npz",
    ];
    refused(&folder, &arguments, IO, "l.npz");
}

/// H.landmarks.json of H.obj lies beside H.vrm, too.
#[test]
fn landmarks_of_another_mesh_are_named_and_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let head = crate::model("default_head");
    fs::copy(head.join("head.obj"), folder.path().join("h.obj")).unwrap();
    let elsewhere = format!("[{}]", vec!["[9,9,9]"; 68].join(","));
    fs::write(folder.path().join("h.landmarks.json"), elsewhere).unwrap();
    let output = anyface(
        folder.path(),
        &["landmarks", "--mesh", "h.obj", "--out", "o.json"],
    );
    let errors = text(&output.stderr);
    assert!(output.status.success(), "{errors}");
    assert!(
        errors.contains("h.landmarks.json does not fit this mesh"),
        "{errors}"
    );
    assert!(folder.path().join("o.json").is_file());
}

/// Their places fit the other mesh too, but they name the mesh that they belong to.
#[test]
fn landmarks_name_their_mesh_and_are_taken_beside_it_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = |arguments: &[&str]| {
        let output = anyface(folder.path(), arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    run(&["head", "--seed", "7", "--out", "h.obj"]);
    let parts = ["parts", "--mesh", "h.obj", "--no-cache"];
    assert_eq!(run(&parts), "");
    let obj = fs::read_to_string(at("h.obj")).unwrap();
    let place = obj.lines().find(|line| line.starts_with("v ")).unwrap();
    fs::write(at("h.obj"), obj.replacen(place, "v 0 0.25 0", 1)).unwrap();
    let said = run(&parts);
    assert!(
        said.contains("expected the landmarks of this mesh"),
        "{said}"
    );
}

/// The command writes the paper's heat maps: the shares of 68 landmarks for each vertex of the skin.
#[test]
fn attention_of_the_papers_decoder_is_written_and_other_decoders_have_none() {
    let folder = folder_with_sound(&hum(0.2), 16_000);
    let head = crate::model("default_head");
    let (mesh, marks) = (head.join("head.obj"), head.join("landmarks.json"));
    let on_head = |first: &[&str], rest: &[&str]| {
        let head = [
            "--mesh",
            mesh.to_str().unwrap(),
            "--landmarks",
            marks.to_str().unwrap(),
        ];
        let arguments = [first, &head, &["--no-cache"], rest].concat();
        anyface(folder.path(), &arguments)
    };
    let output = on_head(&["animate", "--audio", "a.wav", "--out", "o.npz"], &[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let deform = [
        "deform",
        "--motion",
        "o.npz",
        "--out",
        "p.pc2",
        "--attention",
        "a.npz",
    ];
    let refused = on_head(&deform, &[]);
    assert_eq!(refused.status.code(), Some(INVALID_INPUT));
    assert!(
        text(&refused.stderr).contains("paper"),
        "{}",
        text(&refused.stderr)
    );
    let output = on_head(&deform, &["--decoder", "paper"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let file = fs::File::open(folder.path().join("a.npz")).unwrap();
    let mut npz = ndarray_npy::NpzReader::new(file).unwrap();
    let shares: ndarray::Array2<f32> = npz.by_name("attention").unwrap();
    assert_eq!(shares.ncols(), 68);
    let sums: Vec<f32> = shares.rows().into_iter().map(|row| row.sum()).collect();
    // Eyeballs and teeth are no skin, so their shares are zero.
    assert!(
        sums.iter()
            .all(|sum| (sum - 1.0).abs() < 1e-4 || *sum == 0.0)
    );
    assert!(sums.iter().filter(|sum| **sum > 0.5).count() > 4_000);
    // Attention is local. The measure is e to the entropy of a vertex's shares, 68 if all landmarks count
    // alike.
    let mut looked_at: Vec<f32> = shares
        .rows()
        .into_iter()
        .filter(|row| row.sum() > 0.5)
        .map(|row| row.mapv(|share| -share * (share + 1e-12).ln()).sum().exp())
        .collect();
    looked_at.sort_by(f32::total_cmp);
    let median = looked_at[looked_at.len() / 2];
    assert!(median < 15.0, "{median}");
}

/// Shoulders use up the eigenfunctions and leave none for the lips, unless the network works on the head
/// alone.
#[test]
fn shoulders_do_not_silence_the_papers_decoder() {
    let folder = folder_with_sound(&hum(0.4), 16_000);
    let head = crate::model("default_head");
    let marks = head.join("landmarks.json");
    let obj = fs::read_to_string(head.join("head.obj")).unwrap();
    fs::write(folder.path().join("bust.obj"), with_shoulders(&obj)).unwrap();
    let moved = |mesh: &Path| {
        let mesh = ["--mesh", mesh.to_str().unwrap()];
        let marks = ["--landmarks", marks.to_str().unwrap(), "--no-cache"];
        let animate = ["animate", "--audio", "a.wav", "--out", "o.npz"];
        let line = [&animate[..], &mesh, &marks, &["--decoder", "paper"]].concat();
        let ended = anyface(folder.path(), &line);
        assert!(ended.status.success(), "{}", text(&ended.stderr));
        let file = fs::File::open(folder.path().join("o.npz")).unwrap();
        let mut npz = ndarray_npy::NpzReader::new(file).unwrap();
        npz.by_name::<ndarray::OwnedRepr<f32>, ndarray::Ix3>("displacements")
            .unwrap()
    };
    let alone = moved(&head.join("head.obj"));
    let bust = moved(&folder.path().join("bust.obj"));
    let vertices = alone.dim().1;
    assert!(bust.dim().1 > vertices + 400);
    let of_head = bust.slice(ndarray::s![.., ..vertices, ..]);
    let size = |x: ndarray::Array3<f32>| x.mapv(f32::abs).mean().unwrap();
    let (off, motion) = (size(&of_head - &alone), size(alone));
    assert!(off < 0.15 * motion, "{off} of {motion}");
    let shoulders = bust.slice(ndarray::s![.., vertices.., ..]);
    assert!(size(shoulders.to_owned()) < 0.1 * motion);
}

/// Adds shoulders to the head of an OBJ: eight rings that spread out from the rim of the neck.
fn with_shoulders(head: &str) -> String {
    let rows = |kind: &'static str| head.lines().filter_map(move |line| line.strip_prefix(kind));
    let numbers = |row: &str| -> Vec<f64> { row.split(' ').map(|x| x.parse().unwrap()).collect() };
    let points: Vec<Vec<f64>> = rows("v ").map(numbers).collect();
    let corner = |word: &str| word.split('/').next().unwrap().parse::<usize>().unwrap() - 1;
    let mut edges = HashSet::new();
    for face in rows("f ") {
        let face: Vec<usize> = face.split_whitespace().map(corner).collect();
        for (i, &a) in face.iter().enumerate() {
            let b = face[(i + 1) % face.len()];
            if !edges.remove(&(b, a)) {
                edges.insert((a, b));
            }
        }
    }
    let heights = points.iter().map(|p| p[1]);
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(y), h.max(y)));
    let size = high - low;
    edges.retain(|(a, b)| [a, b].iter().all(|&&v| points[v][1] < low + 0.2 * size));
    let rim: BTreeSet<usize> = edges.iter().flat_map(|(a, b)| [*a, *b]).collect();
    let centre =
        [0, 2].map(|axis| rim.iter().map(|&v| points[v][axis]).sum::<f64>() / rim.len() as f64);
    let (mut bust, mut ring) = (
        head.to_owned(),
        BTreeMap::from_iter(rim.iter().map(|&v| (v, v))),
    );
    let mut count = points.len();
    for k in 1..=8 {
        let mut next = BTreeMap::new();
        for &v in &rim {
            let p = &points[v];
            let out = [p[0] - centre[0], p[2] - centre[1]];
            let far = 0.12 * size * f64::from(k) / out[0].hypot(out[1]);
            let y = p[1] - 0.02 * size * f64::from(k);
            bust += &format!("v {} {y} {}\n", p[0] + far * out[0], p[2] + far * out[1]);
            next.insert(v, count);
            count += 1;
        }
        for (a, b) in &edges {
            let [a0, b0, a1, b1] = [ring[a] + 1, ring[b] + 1, next[a] + 1, next[b] + 1];
            bust += &format!("f {b0} {a0} {a1}\nf {b0} {a1} {b1}\n");
        }
        ring = next;
    }
    bust
}

#[test]
fn meshes_that_cannot_be_used_exit_with_5() {
    let folder = folder_with_sound(&hum(0.5), 16_000);
    let animate = [
        "animate", "--mesh", "m.obj", "--audio", "a.wav", "--out", "o.npz",
    ];
    let landmarks = ["landmarks", "--mesh", "m.obj", "--out", "l.json"];
    for body in ["", "v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "f 1 2 3\n"] {
        fs::write(folder.path().join("m.obj"), body).unwrap();
        refused(&folder, &animate, MESH, "mesh: ");
        refused(&folder, &landmarks, MESH, "mesh: ");
    }
}

#[test]
fn errors_are_json_where_results_are() {
    let folder = tempfile::tempdir().unwrap();
    let output = anyface(folder.path(), &[&MOTION[..], &["--json"]].concat());
    assert!(output.stdout.is_empty());
    let error: serde_json::Value = serde_json::from_slice(&output.stderr).unwrap();
    assert_eq!(error["error"]["kind"], "io");
    assert_eq!(error["error"]["code"], IO);
    assert!(
        error["error"]["message"]
            .as_str()
            .unwrap()
            .contains("a.wav")
    );
}

#[test]
fn info_says_the_version() {
    let folder = tempfile::tempdir().unwrap();
    let output = anyface(folder.path(), &["info", "--json"]);
    assert!(output.status.success());
    let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["version"], env!("CARGO_PKG_VERSION"));
    let output = anyface(folder.path(), &["info"]);
    assert!(text(&output.stdout).starts_with("anyface "));
}

/// Five points say where the face is, even on a mesh in which none is found.
#[test]
fn five_points_say_where_a_face_is() {
    let folder = tempfile::tempdir().unwrap();
    let cube = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\nf 1 3 4 2\nf 5 6 8 7\n\
                f 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    fs::write(folder.path().join("cube.obj"), cube).unwrap();
    let find = ["landmarks", "--mesh", "cube.obj", "--out", "l.json"];
    refused(&folder, &find, FACE_NOT_FOUND, "--points takes the five");
    let five = "0.2,0.8,1 0.8,0.8,1 0.5,0.5,1 0.3,0.3,1 0.7,0.3,1";
    done(&folder, &[&find[..], &["--points", five]].concat());
    let written = fs::read_to_string(folder.path().join("l.json")).unwrap();
    let landmarks: serde_json::Value = serde_json::from_str(&written).unwrap();
    let corner = &landmarks["landmarks"][48];
    let place: [f64; 3] = serde_json::from_value(corner["position"].clone()).unwrap();
    assert!(
        place
            .iter()
            .zip([0.3, 0.3, 1.0])
            .all(|(a, b)| (a - b).abs() < 1e-5),
        "{corner}"
    );
    assert_eq!(corner["confidence"], 1.0);
}

fn done(folder: &TempDir, arguments: &[&str]) {
    let output = anyface(folder.path(), arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

fn landmarks(folder: &TempDir, name: &str) -> ndarray::Array3<f32> {
    let read = anyface::output::read_landmark_motion(&folder.path().join(name));
    read.unwrap().displacements
}

/// Indices of the frames that differ.
fn changed(a: &ndarray::Array3<f32>, b: &ndarray::Array3<f32>) -> Vec<usize> {
    let frames = a.outer_iter().zip(b.outer_iter()).enumerate();
    let differ = frames.filter(|(_, (a, b))| a != b);
    differ.map(|(t, _)| t).collect()
}

#[test]
fn sounds_that_are_mended_close_the_lips_there_and_nowhere_else() {
    let folder = folder_with_sound(&hum(2.0), 16_000);
    done(
        &folder,
        &["sounds", "--audio", "a.wav", "--out", "a.TextGrid"],
    );
    let motion = ["motion", "--audio", "a.wav", "--fps", "25", "--out"];
    let with = |out: &'static str, sounds: &'static str| {
        done(&folder, &[&motion[..], &[out, "--sounds", sounds]].concat());
    };
    done(&folder, &[&motion[..], &["heard.npz"]].concat());
    with("same.npz", "a.TextGrid");
    assert_eq!(
        landmarks(&folder, "heard.npz"),
        landmarks(&folder, "same.npz")
    );
    fs::write(folder.path().join("none.txt"), "# nothing closes\n").unwrap();
    fs::write(folder.path().join("one.txt"), "1.00 1.12 b\n").unwrap();
    with("none.npz", "none.txt");
    with("one.npz", "one.txt");
    let (none, one) = (
        landmarks(&folder, "none.npz"),
        landmarks(&folder, "one.npz"),
    );
    let frames = changed(&none, &one);
    assert!(frames.contains(&26), "{frames:?}");
    assert!(frames.iter().all(|t| (24..=30).contains(t)), "{frames:?}");
}

#[test]
fn the_mouth_shows_the_words_of_a_text_and_of_subtitles() {
    let folder = folder_with_sound(&babble(2.0, 16_000), 16_000);
    let motion = ["motion", "--audio", "a.wav", "--fps", "25", "--out"];
    let with = |out: &str, more: &[&str]| {
        done(&folder, &[&motion[..], &[out], more].concat());
        landmarks(&folder, out)
    };
    let heard = with("heard.npz", &[]);
    let told = with("told.npz", &["--text", "papa moves"]);
    assert!(!changed(&heard, &told).is_empty());
    let line = "1\n00:00:00,000 --> 00:00:02,000\npapa moves\n";
    fs::write(folder.path().join("a.srt"), line).unwrap();
    assert!(!changed(&heard, &with("said.npz", &["--sounds", "a.srt"])).is_empty());
    let phones = "start_s\tduration_s\tphone\n1.0\t0.1\tm\n1.1\t0.2\tu\n";
    fs::write(folder.path().join("a.tsv"), phones).unwrap();
    let frames = changed(&heard, &with("phones.npz", &["--sounds", "a.tsv"]));
    assert!(frames.contains(&26), "{frames:?}");
    let empty = [&motion[..], &["x.npz", "--text", "..."]].concat();
    refused(&folder, &empty, INVALID_INPUT, "letter");
}

#[test]
fn words_and_phones_stand_beside_closures() {
    let folder = folder_with_sound(&hum(2.0), 16_000);
    let listen = ["sounds", "--audio", "a.wav", "--json", "--out"];
    let json = |more: &[&str]| -> serde_json::Value {
        let output = anyface(folder.path(), &[&listen[..], more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let plain = json(&["plain.TextGrid"]);
    assert!(plain.get("phones").is_none() && plain.get("words").is_none());
    fs::write(folder.path().join("said.txt"), "\u{FEFF}Mum, hums: 3\n").unwrap();
    let said = json(&["said.TextGrid", "--text-file", "said.txt"]);
    let words = said["words"].as_array().unwrap().iter();
    let labels: Vec<&str> = words.map(|word| word[2].as_str().unwrap()).collect();
    assert_eq!(labels, ["Mum", "hums", "3"]);
    let grid = fs::read_to_string(folder.path().join("said.TextGrid")).unwrap();
    for tier in ["closures", "phones", "words"] {
        assert!(grid.contains(&format!("name = \"{tier}\"")), "{tier}");
    }
    assert_eq!(
        json(&["phones.txt", "--phones"])["closures"],
        plain["closures"]
    );
    let empty = [&listen[..], &["x.txt", "--text", "..."]].concat();
    refused(&folder, &empty, INVALID_INPUT, "letter");
    let missing = [&listen[..], &["x.txt", "--text-file", "none.txt"]].concat();
    refused(&folder, &missing, IO, "none.txt");
}

#[test]
fn one_file_of_sounds_becomes_another() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(
        folder.path().join("a.tsv"),
        "0.00\tX\n0.50\tA\n0.75\tC\n1.00\tX\n",
    )
    .unwrap();
    done(&folder, &["sounds", "--sounds", "a.tsv", "--out", "a.dat"]);
    let switch = fs::read_to_string(folder.path().join("a.dat")).unwrap();
    assert_eq!(switch, "MohoSwitch1\n1 rest\n13 MBP\n19 E\n25 rest\n");
    let back = ["sounds", "--sounds", "a.tsv", "--out", "a.srt"];
    refused(&folder, &back, INVALID_INPUT, "only read");
    fs::write(folder.path().join("b.tsv"), "0.00\tX\nsoon\tA\n").unwrap();
    let damaged = ["sounds", "--sounds", "b.tsv", "--out", "a.dat.txt"];
    refused(&folder, &damaged, INVALID_INPUT, "b.tsv:2: expected a time");
}

#[test]
fn a_stretch_of_landmark_motion_is_made_again_and_the_rest_stays_to_the_bit() {
    let folder = folder_with_sound(&hum(2.0), 16_000);
    let motion = ["motion", "--audio", "a.wav", "--fps", "25", "--out"];
    done(&folder, &[&motion[..], &["was.npz"]].concat());
    let redo = ["--redo", "0.8-1.6", "--from", "was.npz"];
    let sad = ["--emotion", "sad:1"];
    done(&folder, &[&motion[..], &["sad.npz"], &sad].concat());
    done(&folder, &[&motion[..], &["new.npz"], &redo, &sad].concat());
    let [was, new, sad] = ["was.npz", "new.npz", "sad.npz"].map(|name| landmarks(&folder, name));
    assert_eq!(changed(&was, &new), (21..40).collect::<Vec<_>>());
    assert!(changed(&sad, &new).iter().all(|t| !(23..=37).contains(t)));
    let alone = [&motion[..], &["o.npz", "--redo", "0.8-1.6"]].concat();
    refused(&folder, &alone, USAGE, "--from");
    let slower = [
        "motion", "--audio", "a.wav", "--fps", "24", "--out", "o.npz",
    ];
    let words = "expected 48 frames at 24 fps";
    refused(
        &folder,
        &[&slower[..], &redo].concat(),
        INVALID_INPUT,
        words,
    );
    let beyond = [
        &motion[..],
        &["o.npz", "--redo", "7-8", "--from", "was.npz"],
    ]
    .concat();
    refused(&folder, &beyond, INVALID_INPUT, "holds a frame");
}

#[test]
fn motion_of_weights_has_a_file_a_table_and_stretches_that_are_made_again() {
    let folder = folder_with_sound(&hum(2.0), 16_000);
    let motion = [
        "motion",
        "--audio",
        "a.wav",
        "--fps",
        "25",
        "--system",
        "cafe-talk",
        "--out",
    ];
    let weights = |name: &str| {
        let read = anyface::output::read_weights(&folder.path().join(name));
        read.unwrap().unwrap().weights
    };
    done(&folder, &[&motion[..], &["was.npz"]].concat());
    let event = ["--event", "0.9-1.5:26"];
    done(&folder, &[&motion[..], &["table.csv"], &event].concat());
    done(&folder, &[&motion[..], &["drop.npz"], &event].concat());
    let table = fs::read_to_string(folder.path().join("table.csv")).unwrap();
    assert_eq!(table.lines().count(), 51);
    let redo = ["--redo", "0.8-1.6", "--from", "was.npz"];
    done(
        &folder,
        &[&motion[..], &["new.npz"], &redo, &event].concat(),
    );
    let [was, new, drop] = ["was.npz", "new.npz", "drop.npz"].map(weights);
    let differ = |a: &ndarray::Array2<f32>, b: &ndarray::Array2<f32>| -> Vec<usize> {
        (0..a.nrows()).filter(|&t| a.row(t) != b.row(t)).collect()
    };
    assert!(differ(&was, &new).iter().all(|t| (21..40).contains(t)));
    assert!(differ(&drop, &new).iter().all(|t| !(23..=37).contains(t)));
    assert!(differ(&was, &new).len() > 10);
    // On a mesh, the weights move its own shapes, just as `animate` does.
    let head = crate::model("default_head");
    let (mesh, marks) = (head.join("head.obj"), head.join("landmarks.json"));
    let [mesh, marks] = [&mesh, &marks].map(|path| path.to_str().unwrap());
    let on_head = ["--mesh", mesh, "--landmarks", marks, "--no-cache"];
    let deform = ["deform", "--motion", "drop.npz", "--out", "a.npz"];
    done(&folder, &[&deform[..], &on_head].concat());
    let animate = [
        "animate",
        "--audio",
        "a.wav",
        "--fps",
        "25",
        "--system",
        "cafe-talk",
        "--out",
        "b.npz",
    ];
    done(&folder, &[&animate[..], &event, &on_head].concat());
    let moved = |name: &str| -> ndarray::Array3<f32> {
        let file = fs::File::open(folder.path().join(name)).unwrap();
        ndarray_npy::NpzReader::new(file)
            .unwrap()
            .by_name("displacements")
            .unwrap()
    };
    assert_eq!(moved("a.npz"), moved("b.npz"));
    // Another system makes landmarks, which cannot stand in for weights and cannot be written to a table.
    let other = ["motion", "--audio", "a.wav", "--fps", "25", "--out"];
    done(&folder, &[&other[..], &["marks.npz"]].concat());
    let mixed = ["o.npz", "--redo", "0.8-1.6", "--from", "marks.npz"];
    let words = "expected arrays weights and names";
    refused(
        &folder,
        &[&motion[..], &mixed].concat(),
        INVALID_INPUT,
        words,
    );
    let words = ".npz for motion of landmarks";
    refused(
        &folder,
        &[&other[..], &["o.csv"]].concat(),
        INVALID_INPUT,
        words,
    );
}

/// Copies an animation, but keeps only the first frame of its landmarks.
fn shorten_landmarks(from: &Path, to: &Path) {
    let file = fs::File::open(from).unwrap();
    let mut npz = ndarray_npy::NpzReader::new(file).unwrap();
    let mut out = ndarray_npy::NpzWriter::new(fs::File::create(to).unwrap());
    for name in npz.names().unwrap() {
        let name = name.trim_end_matches(".npy").to_owned();
        if name == "fps" {
            let fps: ndarray::Array0<f64> = npz.by_name(&name).unwrap();
            out.add_array(&name, &fps).unwrap();
            continue;
        }
        let mut array: ndarray::ArrayD<f32> = npz.by_name(&name).unwrap();
        if name == "landmark_displacements" {
            array.slice_axis_inplace(ndarray::Axis(0), (..1).into());
        }
        out.add_array(&name, &array).unwrap();
    }
    out.finish().unwrap();
}

#[test]
fn a_stretch_of_an_animated_mesh_is_made_again_and_the_rest_stays_to_the_bit() {
    let folder = folder_with_sound(&hum(0.8), 16_000);
    let head = crate::model("default_head");
    let (mesh, marks) = (head.join("head.obj"), head.join("landmarks.json"));
    let [mesh, marks] = [&mesh, &marks].map(|path| path.to_str().unwrap());
    let animate = [
        "animate",
        "--audio",
        "a.wav",
        "--mesh",
        mesh,
        "--landmarks",
        marks,
        "--fps",
        "25",
        "--cache",
        "kept",
        "--out",
    ];
    done(&folder, &[&animate[..], &["was.npz"]].concat());
    let redo = ["--redo", "0.2-0.6", "--from", "was.npz"];
    done(&folder, &[&animate[..], &["same.npz"], &redo].concat());
    done(
        &folder,
        &[&animate[..], &["new.npz"], &redo, &["--emotion", "angry:1"]].concat(),
    );
    shorten_landmarks(
        &folder.path().join("was.npz"),
        &folder.path().join("short.npz"),
    );
    let short = ["--redo", "0.2-0.6", "--from", "short.npz"];
    let words = [&animate[..], &["o.npz"], &short].concat();
    refused(
        &folder,
        &words,
        3,
        "as many frames of landmarks as of vertices, 20, got 1",
    );
    let mesh = anyface::mesh::Mesh::read(std::path::Path::new(mesh)).unwrap();
    let [was, same, new] = ["was.npz", "same.npz", "new.npz"].map(|name| {
        let read = anyface::output::read_vertex_motion(&folder.path().join(name), &mesh);
        read.unwrap().displacements
    });
    assert_eq!(changed(&was, &same), [] as [usize; 0]);
    assert_eq!(changed(&was, &new), (6..15).collect::<Vec<_>>());
}

#[test]
fn a_emotion_in_a_word_that_is_no_category_is_for_a_system_that_takes_words() {
    let folder = folder_with_sound(&hum(1.0), 16_000);
    let motion = ["motion", "--audio", "a.wav", "--fps", "25", "--out"];
    let cafe = ["--system", "cafe-talk"];
    let weights = |name: &str, emotion: &[&str]| {
        done(&folder, &[&motion[..], &[name], &cafe, emotion].concat());
        let read = anyface::output::read_weights(&folder.path().join(name));
        read.unwrap().unwrap().weights
    };
    let angry = weights("angry.npz", &["--emotion", "angry"]);
    let furious = weights("furious.npz", &["--emotion", "furious"]);
    let happy = weights("happy.npz", &["--emotion-keys", "0:joyful"]);
    let apart = |other: &ndarray::Array2<f32>| (other - &angry).mapv(f32::abs).sum();
    assert!(apart(&furious) > 0.0 && apart(&furious) < 0.3 * apart(&happy));
    let furious_line = [&motion[..], &["o.npz", "--emotion", "furious"]].concat();
    let known = "expected one of neutral, happy";
    refused(&folder, &furious_line, INVALID_INPUT, known);
    let nothing = [&motion[..], &["o.npz", "--emotion", "bicycle"], &cafe].concat();
    refused(
        &folder,
        &nothing,
        INVALID_INPUT,
        "or an English word for an emotion",
    );
}

#[test]
fn texts_become_units_or_are_refused_with_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let output = anyface(
        folder.path(),
        &["units", "winks with the right eye", "--json"],
    );
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let unit = &said["units"][0];
    assert_eq!(
        (unit["unit"].as_str(), unit["side"].as_str()),
        (Some("45"), Some("right"))
    );
    let near = "got \"tetchy\"; the nearest that is understood: \"ashamed\"";
    refused(&folder, &["units", "tetchy"], INVALID_INPUT, near);
    let blue = "got \"the blue car\"";
    refused(&folder, &["units", "the blue car"], INVALID_INPUT, blue);
    refused(
        &folder,
        &["units", ""],
        INVALID_INPUT,
        "expected English words",
    );
}
