//! Files that once broke readers, and surroundings that break commands. The command ends by itself, within
//! limits of time and memory, with the exit code of its error, and leaves nothing half done.

use std::{
    fs,
    io::Read,
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    time::{Duration, Instant},
};

use anyface::{face::Rig, mesh::Mesh, output::write_rig};
use ndarray::Array3;
use tempfile::TempDir;

/// The longest time that a file of a few kilobytes may take.
const LONGEST: Duration = Duration::from_secs(20);
/// The most memory that such a file may take, in bytes.
#[cfg(target_os = "linux")]
const MAX_MEMORY: u64 = 1 << 30;
/// Rows and columns of the mesh, which has as many vertices as the animations among the files.
const GRID: [usize; 2] = [18, 26];
/// Kinds of error of a refused file. A mesh file may also hold no face.
const REFUSED: [&str; 5] = [
    "invalid_input",
    "shape_mismatch",
    "audio",
    "mesh",
    "face_not_found",
];

struct Ended {
    status: Option<ExitStatus>,
    errors: String,
    #[cfg(target_os = "linux")]
    memory: u64,
}

fn start(folder: &Path, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_anyface"))
        .current_dir(folder)
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Runs the command, and ends it if it takes too long.
fn run(folder: &Path, arguments: &[&str]) -> Ended {
    let mut child = start(folder, arguments);
    let began = Instant::now();
    let mut pipe = child.stderr.take().unwrap();
    let reading = std::thread::spawn(move || {
        let mut text = Vec::new();
        pipe.read_to_end(&mut text).unwrap();
        String::from_utf8_lossy(&text).into_owned()
    });
    #[cfg(target_os = "linux")]
    let mut memory = 0;
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break Some(status);
        }
        if began.elapsed() > LONGEST {
            child.kill().unwrap();
            child.wait().unwrap();
            break None;
        }
        #[cfg(target_os = "linux")]
        {
            memory = memory.max(peak(child.id()));
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    Ended {
        status,
        errors: reading.join().unwrap(),
        #[cfg(target_os = "linux")]
        memory,
    }
}

/// Peak memory of a process so far, in bytes.
#[cfg(target_os = "linux")]
fn peak(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kilobytes.unwrap_or(0) * 1024
}

/// Says what is wrong with a run. `None` if it went as it should.
fn complaint(ended: &Ended) -> Option<String> {
    #[cfg(target_os = "linux")]
    if ended.memory > MAX_MEMORY {
        return Some(format!("took {} MB", ended.memory >> 20));
    }
    let Some(status) = ended.status else {
        return Some("took longer than 20 s".into());
    };
    if status.success() {
        return None;
    }
    // With --json, standard error holds only the error.
    let error: serde_json::Value = match serde_json::from_str(ended.errors.trim()) {
        Ok(error) => error,
        Err(_) => return Some(format!("{status}: {}", ended.errors)),
    };
    let kind = error["error"]["kind"].as_str().unwrap_or_default();
    (!REFUSED.contains(&kind)).then(|| format!("{status}: {}", ended.errors))
}

fn shared(name: &str) -> Vec<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let shared = std::env::var_os("ANYFACE_SHARED").map_or(beside, Into::into);
    let files = fs::read_dir(shared.join("hostile").join(name)).unwrap();
    let mut files: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    files.sort();
    files
}

/// A folder with a mesh that fits the animations, shapes of it, and landmarks that need no search.
fn stage() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let [rows, columns] = GRID;
    let at = |r: usize, c: usize| (r * columns + c) as u32;
    let mut mesh = Mesh::default();
    for r in 0..rows {
        for c in 0..columns {
            mesh.positions
                .push([c as f32, r as f32, 0.1 * (r * c) as f32]);
            if r + 1 < rows && c + 1 < columns {
                mesh.triangles.push([at(r, c), at(r, c + 1), at(r + 1, c)]);
                mesh.triangles
                    .push([at(r + 1, c), at(r, c + 1), at(r + 1, c + 1)]);
            }
        }
    }
    let mut text = String::new();
    for [x, y, z] in &mesh.positions {
        text += &format!("v {x} {y} {z}\n");
    }
    for t in &mesh.triangles {
        text += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
    }
    fs::write(folder.path().join("grid.obj"), text).unwrap();
    let moved = |(s, v, i): (usize, usize, usize)| ((s + 1) * (v % 7) + i) as f32 * 0.01;
    let rig = Rig {
        names: vec!["jawOpen".into(), "mouthPucker".into()],
        deltas: Array3::from_shape_fn((2, rows * columns, 3), moved),
        reports: Vec::new(),
    };
    write_rig(&folder.path().join("rig.npz"), &rig, &mesh).unwrap();
    let numbers: Vec<String> = (0..68).map(|n| (n % 4).to_string()).collect();
    let marks = format!("[{}]", numbers.join(","));
    fs::write(folder.path().join("marks.json"), marks).unwrap();
    folder
}

#[test]
#[ignore = "needs ../shared"]
fn every_hostile_file_is_read_or_refused() {
    let folder = stage();
    let mut bad = Vec::new();
    let mut runs = 0;
    let mut check = |file: &Path, arguments: &[&str]| {
        runs += 1;
        let name = file.file_name().unwrap().to_string_lossy();
        if let Some(complaint) = complaint(&run(folder.path(), arguments)) {
            bad.push(format!("{name}: {} {complaint}", arguments[0]));
        }
    };
    for file in shared("mesh") {
        let path = file.to_str().unwrap();
        let marks = ["--landmarks", "marks.json", "--no-cache", "--json"];
        check(&file, &[&["parts", "--mesh", path][..], &marks].concat());
    }
    for file in shared("audio") {
        let path = file.to_str().unwrap();
        let out = ["--out", "o.npz", "--causal", "--json"];
        check(&file, &[&["motion", "--audio", path][..], &out].concat());
    }
    for file in shared("npz") {
        let path = file.to_str().unwrap();
        let out = ["--rig", "rig.npz", "--out", "w.csv", "--json"];
        let solve = ["solve", "--mesh", "grid.obj", "--animation", path];
        check(&file, &[&solve[..], &out].concat());
        if path.ends_with(".npz") {
            let marks = [
                "--landmarks",
                "marks.json",
                "--out",
                "d.npz",
                "--no-cache",
                "--json",
            ];
            let deform = ["deform", "--mesh", "grid.obj", "--motion", path];
            check(&file, &[&deform[..], &marks].concat());
        }
    }
    let names: Vec<_> = fs::read_dir(&folder)
        .unwrap()
        .flatten()
        .map(|f| f.file_name())
        .collect();
    let halves = names
        .iter()
        .filter(|name| name.to_string_lossy().ends_with(".part"));
    assert_eq!(halves.count(), 0, "{names:?}");
    assert!(runs > 100, "{runs} runs");
    assert!(
        bad.is_empty(),
        "{} of {runs}:\n{}",
        bad.len(),
        bad.join("\n")
    );
}

/// Small files whose values would take gigabytes.
#[cfg(target_os = "linux")]
#[test]
fn small_files_do_not_grow_in_memory() {
    let folder = stage();
    let nodes = format!(r#"{{"nodes":[{}{{}}]}}"#, "{},".repeat(4_000_000));
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((20 + nodes.len() as u32).to_le_bytes());
    glb.extend((nodes.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(nodes.as_bytes());
    fs::write(folder.path().join("many.glb"), glb).unwrap();
    let numbers = "0,".repeat(8_000_000);
    fs::write(folder.path().join("long.json"), format!("[{numbers}0]")).unwrap();
    let most = 300 << 20;
    for (kind, line) in [
        ("mesh", "parts --mesh many.glb --landmarks marks.json"),
        (
            "invalid_input",
            "parts --mesh grid.obj --landmarks long.json",
        ),
    ] {
        let line = format!("{line} --json");
        let ended = run(folder.path(), &line.split(' ').collect::<Vec<_>>());
        assert!(
            ended.errors.contains(&format!("\"{kind}\"")),
            "{line}: {}",
            ended.errors
        );
        assert!(ended.errors.contains("MiB"), "{line}: {}", ended.errors);
        assert!(ended.memory < most, "{line}: {} MB", ended.memory >> 20);
    }
}

/// Whether text holds characters that steer a terminal.
fn steers(text: &[u8]) -> bool {
    let text = String::from_utf8_lossy(text);
    text.chars().any(|c| c.is_control() && !"\n\t".contains(c))
}

#[test]
fn names_of_files_and_objects_cannot_steer_a_terminal() {
    let folder = stage();
    let head = crate::model("default_head");
    let text = fs::read_to_string(head.join("head.obj")).unwrap();
    let named = text.replace("o skin\n", "o Face\u{1b}]0;title\u{7}\u{9b}2J\n");
    fs::write(folder.path().join("named.obj"), named).unwrap();
    let command = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_anyface"));
        let command = command.current_dir(folder.path()).args(arguments);
        command.output().unwrap()
    };
    let marks = head.join("landmarks.json");
    let marks = ["--landmarks", marks.to_str().unwrap(), "--no-cache"];
    let parts = [&["parts", "--mesh", "named.obj"][..], &marks].concat();
    for json in [&[][..], &["--json"]] {
        let ended = command(&[&parts[..], json].concat());
        let [text, errors] = [&ended.stdout, &ended.stderr];
        assert!(!steers(text) && !steers(errors), "{ended:?}");
        let text = String::from_utf8_lossy(text);
        assert!(text.contains(r"Face\u001b]0;title\u0007\u009b2J"), "{text}");
    }
    for line in [
        &["parts", "--mesh", "no\u{1b}[31mfile.obj"][..],
        &["parts", "--mesh\u{1b}[31m"],
        &["\u{7}parts"],
        &[
            "motion",
            "--audio",
            "a.wav",
            "--out",
            "o.npz",
            "--emotion",
            "\u{1b}c:1",
        ],
    ] {
        let ended = command(line);
        assert!(!ended.status.success());
        assert!(!steers(&ended.stderr), "{line:?}: {ended:?}");
    }
}

#[cfg(unix)]
#[test]
fn a_folder_of_weights_with_links_to_itself_ends() {
    let folder = stage();
    sound(folder.path(), 1);
    let weights = folder.path().join("weights");
    fs::create_dir(&weights).unwrap();
    for link in ["a", "b"] {
        std::os::unix::fs::symlink(".", weights.join(link)).unwrap();
    }
    fs::write(folder.path().join("rows.csv"), "audio,out\na.wav,o.npz\n").unwrap();
    let ended = run(
        folder.path(),
        &["batch", "rows.csv", "--weights", "weights"],
    );
    assert!(
        ended.status.is_some_and(|status| !status.success()),
        "{}",
        ended.errors
    );
}

/// Names a device that never ends for every option that takes a file.
#[cfg(target_os = "linux")]
#[test]
fn no_file_is_read_without_end() {
    let folder = stage();
    sound(folder.path(), 1);
    let zero = "/dev/zero";
    std::os::unix::fs::symlink(zero, folder.path().join("zero.npz")).unwrap();
    std::os::unix::fs::symlink(zero, folder.path().join("zero.mdd")).unwrap();
    std::os::unix::fs::symlink(zero, folder.path().join("zero.TextGrid")).unwrap();
    for kind in ["weights/ear", "speech"] {
        let model = folder.path().join(kind);
        fs::create_dir_all(&model).unwrap();
        fs::write(model.join("config.json"), r#"{"model_type": "hubert"}"#).unwrap();
        std::os::unix::fs::symlink(zero, model.join("model.safetensors")).unwrap();
    }
    let mesh = ["--mesh", "grid.obj"];
    let marks = ["--landmarks", "marks.json"];
    let voice = ["--audio", "a.wav", "--out", "o.npz"];
    for (code, arguments) in [
        (5, &["parts", "--mesh", zero][..]),
        (3, &["parts", "--mesh", "grid.obj", "--landmarks", zero]),
        (
            3,
            &[
                "landmarks",
                "--mesh",
                "grid.obj",
                "--out",
                "l.json",
                "--fix",
                zero,
            ],
        ),
        (3, &["head", "--code", zero, "--out", "h.obj"]),
        (5, &["head", "--like", zero, "--out", "h.obj"]),
        (
            3,
            &[
                "sounds",
                "--audio",
                "a.wav",
                "--text-file",
                zero,
                "--out",
                "o.TextGrid",
            ],
        ),
        (
            3,
            &["sounds", "--sounds", "zero.TextGrid", "--out", "o.dat"],
        ),
        (4, &["motion", "--audio", zero, "--out", "o.npz"]),
        (3, &[&["motion", "--events", zero][..], &voice].concat()),
        (
            3,
            &[&["motion", "--sounds", "zero.TextGrid"][..], &voice].concat(),
        ),
        (
            7,
            &[&["motion", "--weights", "weights"][..], &voice].concat(),
        ),
        (7, &[&["motion", "--speech", "speech"][..], &voice].concat()),
        (
            3,
            &[
                &["deform", "--motion", "zero.npz", "--out", "d.npz"][..],
                &mesh,
                &marks,
            ]
            .concat(),
        ),
        (
            3,
            &[
                &[
                    "solve",
                    "--animation",
                    "zero.mdd",
                    "--rig",
                    "rig.npz",
                    "--out",
                    "w.csv",
                ][..],
                &mesh,
            ]
            .concat(),
        ),
        (
            3,
            &[
                &[
                    "solve",
                    "--animation",
                    "zero.npz",
                    "--rig",
                    "rig.npz",
                    "--out",
                    "w.csv",
                ][..],
                &mesh,
            ]
            .concat(),
        ),
    ] {
        let ended = run(folder.path(), &[arguments, &["--json"]].concat());
        let code_of = ended.status.and_then(|status| status.code());
        assert_eq!(code_of, Some(code), "{arguments:?}: {}", ended.errors);
        assert!(
            ended.errors.contains("got more"),
            "{arguments:?}: {}",
            ended.errors
        );
    }
}

/// Nobody writes to the pipe.
#[cfg(target_os = "linux")]
#[test]
fn a_signal_ends_the_wait_for_a_pipe() {
    let folder = stage();
    let status = Command::new("mkfifo")
        .arg(folder.path().join("pipe"))
        .status();
    assert!(status.unwrap().success());
    for arguments in [
        &["parts", "--mesh", "pipe"][..],
        &["parts", "--mesh", "grid.obj", "--landmarks", "pipe"],
        &["motion", "--audio", "pipe", "--out", "o.npz"],
    ] {
        let mut child = start(folder.path(), arguments);
        // The wait has begun once its thread exists.
        let waits = || {
            let tasks = fs::read_dir(format!("/proc/{}/task", child.id()));
            let names = tasks
                .into_iter()
                .flatten()
                .flatten()
                .map(|task| task.path().join("comm"));
            names
                .into_iter()
                .any(|name| fs::read_to_string(name).is_ok_and(|name| name.trim() == "pipe"))
        };
        let began = Instant::now();
        while !waits() {
            assert!(began.elapsed() < LONGEST, "{arguments:?} does not wait");
            std::thread::sleep(Duration::from_millis(5));
        }
        let sent = Command::new("kill")
            .args(["-TERM", &child.id().to_string()])
            .status();
        assert!(sent.unwrap().success());
        let signalled = Instant::now();
        while child.try_wait().unwrap().is_none() {
            if signalled.elapsed() > LONGEST {
                child.kill().unwrap();
                panic!("{arguments:?} waits on");
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(child.wait().unwrap().code(), Some(9), "{arguments:?}");
    }
}

/// `ulimit -f` ends a process by a signal, unless the process handles it.
#[cfg(target_os = "linux")]
#[test]
fn a_file_beyond_the_limit_of_its_size_is_an_error_that_leaves_nothing() {
    let folder = crate::folder_with_sound(&crate::voice::babble(1.0, 16_000), 16_000);
    let head = crate::model("default_head");
    let before = fs::read_dir(folder.path()).unwrap().count();
    for out in ["o.npz", "o.pc2", "o.mdd"] {
        let line = format!(
            "ulimit -f 100; exec {} animate --mesh {} --landmarks {} --audio a.wav --out {out} --no-cache",
            env!("CARGO_BIN_EXE_anyface"),
            head.join("head.obj").display(),
            head.join("landmarks.json").display(),
        );
        let mut shell = Command::new("bash");
        let ended = shell
            .current_dir(folder.path())
            .args(["-c", &line])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(8), "{out}: {said}");
        assert!(said.contains(out), "{said}");
        assert_eq!(
            fs::read_dir(folder.path()).unwrap().count(),
            before,
            "{out}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_folder_that_failed_to_fill_goes_again() {
    let folder = stage();
    let before = files(folder.path());
    let head = crate::model("default_head");
    let [mesh, marks] =
        ["head.obj", "landmarks.json"].map(|name| head.join(name).display().to_string());
    let rig = [
        "rig",
        "--mesh",
        &mesh,
        "--landmarks",
        &marks,
        "--no-cache",
        "--out",
        "new/rig/",
    ];
    // A folder stands where the report belongs, so the run fails only at its end.
    fs::create_dir(folder.path().join("report.json")).unwrap();
    let ended = run(
        folder.path(),
        &[&rig[..], &["--report", "report.json"]].concat(),
    );
    assert_eq!(ended.status.unwrap().code(), Some(8), "{}", ended.errors);
    fs::remove_dir(folder.path().join("report.json")).unwrap();
    assert_eq!(files(folder.path()), before);
    // A folder that existed before stays.
    fs::create_dir_all(folder.path().join("new")).unwrap();
    fs::create_dir(folder.path().join("report.json")).unwrap();
    run(
        folder.path(),
        &[&rig[..], &["--report", "report.json"]].concat(),
    );
    assert!(folder.path().join("new").is_dir() && !folder.path().join("new/rig").exists());
}

/// Users of the command should not see what decoders log.
#[test]
fn logs_of_decoders_do_not_reach_standard_error() {
    let folder = tempfile::tempdir().unwrap();
    let fixtures = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../rust-core/tests/fixtures");
    let mp3 = fs::read(fixtures.join("sweep_plain.mp3")).unwrap();
    // The decoder logs stray bytes between the packets.
    let damaged = [&mp3[..mp3.len() / 2], &[7; 3_000], &mp3[mp3.len() / 2..]].concat();
    fs::write(folder.path().join("a.mp3"), damaged).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_anyface"));
    let sounds = ["sounds", "--audio", "a.mp3", "--out", "a.TextGrid"];
    let ended = command
        .current_dir(folder.path())
        .env("ANYFACE_LOG", "trace")
        .args(sounds)
        .output();
    let said = String::from_utf8_lossy(&ended.unwrap().stderr).into_owned();
    assert!(!said.contains("symphonia"), "{said}");
}

#[test]
fn a_result_never_replaces_what_it_is_made_from() {
    let folder = stage();
    let before = fs::read(folder.path().join("grid.obj")).unwrap();
    for arguments in [
        &["landmarks", "--mesh", "grid.obj", "--out", "./grid.obj"][..],
        &["open-mouth", "--mesh", "grid.obj", "--out", "grid.obj"],
        &[
            "solve",
            "--mesh",
            "grid.obj",
            "--animation",
            "a.mdd",
            "--rig",
            "rig.npz",
            "--out",
            "rig.npz",
        ],
        // Results whose names derive from those of other results.
        &[
            "open-mouth",
            "--mesh",
            "grid.obj",
            "--landmarks",
            "h.landmarks.json",
            "--out",
            "h.obj",
        ],
        &[
            "animate",
            "--mesh",
            "t_open_mouth.obj",
            "--audio",
            "a.wav",
            "--out",
            "t.npz",
            "--open-mouth",
        ],
        &[
            "head",
            "--like",
            "h.ply",
            "--like-landmarks",
            "h.landmarks.json",
            "--out",
            "h.obj",
        ],
        &["rig", "--mesh", "rig/jawOpen.obj", "--out", "rig/"],
    ] {
        let ended = run(folder.path(), arguments);
        assert_eq!(
            ended.status.unwrap().code(),
            Some(3),
            "{arguments:?}: {}",
            ended.errors
        );
        assert!(ended.errors.contains("would replace"), "{}", ended.errors);
    }
    assert_eq!(fs::read(folder.path().join("grid.obj")).unwrap(), before);
}

#[cfg(target_os = "linux")]
#[test]
fn under_any_limit_of_memory_the_command_ends_well_and_leaves_nothing() {
    let folder = crate::folder_with_sound(&crate::voice::babble(2.0, 16_000), 16_000);
    let mesh = crate::model("default_head").join("head.obj");
    let (command, mesh) = (env!("CARGO_BIN_EXE_anyface"), mesh.display());
    let before = fs::read_dir(folder.path()).unwrap().count();
    let animate = format!("animate --mesh {mesh}");
    // Steps of 47 MB from 100 to 1,000 MB, and one limit far above.
    let limits = (0..20).map(|step| 100 + step * 900 / 19).chain([2_000]);
    for work in [animate.as_str(), "motion"] {
        let mut codes = Vec::new();
        for megabytes in limits.clone() {
            let line = format!(
                "ulimit -v {}; exec {command} {work} --audio a.wav --out o.npz --no-cache --threads 2",
                megabytes * 1000
            );
            let mut shell = Command::new("sh");
            let ended = shell
                .current_dir(folder.path())
                .args(["-c", &line])
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&ended.stderr);
            let code = ended.status.code();
            match code {
                Some(0) => fs::remove_file(folder.path().join("o.npz")).unwrap(),
                _ => assert!(
                    code == Some(13) && said.contains("out of memory"),
                    "{work} {megabytes} MB, {code:?}: {said}"
                ),
            }
            let left = fs::read_dir(folder.path()).unwrap().count();
            assert_eq!(left, before, "{work} {megabytes} MB");
            codes.push(code);
        }
        assert_eq!(
            (codes[0], codes[codes.len() - 1]),
            (Some(13), Some(0)),
            "{work}"
        );
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_reader_that_has_left_is_no_error_and_a_full_disk_is_one() {
    let info = |out: Stdio| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_anyface"));
        command.arg("info").stdout(out).output().unwrap()
    };
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let left = info(writer.into());
    assert!(
        left.status.success(),
        "{}",
        String::from_utf8_lossy(&left.stderr)
    );
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let full = info(full.into());
    assert_eq!(full.status.code(), Some(8));
    let message = String::from_utf8_lossy(&full.stderr);
    assert!(message.contains("standard output"), "{message}");
}

/// A voice-like tone as `a.wav`.
#[cfg(unix)]
fn sound(folder: &Path, seconds: usize) {
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: 16_000,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut wav = hound::WavWriter::create(folder.join("a.wav"), spec).unwrap();
    for i in 0..seconds * 16_000 {
        let x = (i as f32 * 0.08).sin() * (i as f32 * 0.0015).sin();
        wav.write_sample((x * 9000.0) as i16).unwrap();
    }
    wav.finalize().unwrap();
}

/// Starts a job with `arguments` and sends it a signal once `is_time` says so. Expects an orderly end that
/// leaves nothing but the sound.
#[cfg(unix)]
fn interrupted(folder: &Path, arguments: &[&str], signal: &str, is_time: impl Fn() -> bool) {
    let head = crate::model("default_head");
    let (mesh, marks) = (head.join("head.obj"), head.join("landmarks.json"));
    let face = ["--mesh", mesh.to_str().unwrap(), "--landmarks"];
    let sound = ["--audio", "a.wav", "--no-cache"];
    let all = [arguments, &face, &[marks.to_str().unwrap()], &sound].concat();
    let mut child = start(folder, &all);
    let began = Instant::now();
    while !is_time() {
        std::thread::sleep(Duration::from_millis(2));
        let ended = child.try_wait().unwrap();
        assert!(ended.is_none(), "{arguments:?} ended by itself: {ended:?}");
    }
    let sent = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
    let signalled = Instant::now();
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    let spent = signalled.elapsed();
    assert_eq!(
        output.status.code(),
        Some(9),
        "{arguments:?} {signal} after {:?}, in {spent:?}: {message}",
        began.elapsed()
    );
    assert!(message.contains("cancelled"), "{message}");
    let left: Vec<_> = files(folder).into_iter().filter(|n| n != "a.wav").collect();
    assert!(left.is_empty(), "{arguments:?} {signal}: {left:?}");
}

#[cfg(unix)]
fn files(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|file| file.unwrap());
    names
        .map(|file| file.file_name().to_string_lossy().into_owned())
        .collect()
}

#[cfg(unix)]
#[test]
fn a_signal_cancels_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    sound(folder.path(), 60);
    let arguments = ["animate", "--out", "o.pc2"];
    let writes = || files(folder.path()).len() > 1;
    interrupted(folder.path(), &arguments, "-TERM", writes);
    let began = Instant::now();
    let half_a_second = || began.elapsed() > Duration::from_millis(500);
    interrupted(folder.path(), &arguments, "-INT", half_a_second);
}

/// A job with several results leaves none of them if the last is unfinished.
#[cfg(unix)]
#[test]
fn a_signal_leaves_no_layer_and_no_mask_behind() {
    let folder = tempfile::tempdir().unwrap();
    sound(folder.path(), 60);
    let layers = ["--layers", "content,emotion", "--mask-out", "m.npz"];
    let arguments = ["animate", "--system", "emoface", "--out", "o.pc2"];
    // The mask and one layer are whole, and the other layer is being written.
    let third = || files(folder.path()).len() > 3;
    let all = [&arguments[..], &layers].concat();
    interrupted(folder.path(), &all, "-TERM", third);
}

/// `ANYFACE_SIGNALS` says how many jobs of each system are interrupted at random moments.
#[cfg(unix)]
#[test]
fn no_system_leaves_anything_after_a_signal_at_any_moment() {
    let folder = tempfile::tempdir().unwrap();
    // More sound than any machine gets through before the latest signal.
    sound(folder.path(), 300);
    let count = std::env::var("ANYFACE_SIGNALS").map_or(1, |text| text.parse().unwrap());
    let mut moment = 0u64;
    for number in 0..count {
        for system in anyface::systems::SYSTEMS.iter().map(|system| system.name) {
            moment = (moment * 6_364_136 + 1_442_695) % 3_000;
            let out = ["o.npz", "o.pc2", "o.mdd"][number % 3];
            let mut arguments = vec!["animate", "--system", system, "--out", out];
            if system == "emoface" {
                arguments.extend(["--layers", "content,emotion", "--mask-out", "m.npz"]);
            }
            let signal = ["-INT", "-TERM", "-HUP"][(moment % 3) as usize];
            let began = Instant::now();
            let is_time = || began.elapsed() > Duration::from_millis(moment);
            interrupted(folder.path(), &arguments, signal, is_time);
        }
    }
}

/// Writes the default head to `head.obj`, with every triangle cut in four, `times` times over.
#[cfg(target_os = "linux")]
fn head_cut(folder: &Path, times: usize) {
    let mut mesh = Mesh::read(crate::model("default_head").join("head.obj")).unwrap();
    for _ in 0..times {
        mesh = mesh.cut_in_four();
    }
    let mut text = String::new();
    for [x, y, z] in &mesh.positions {
        text += &format!("v {x} {y} {z}\n");
    }
    for t in &mesh.triangles {
        text += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
    }
    fs::write(folder.join("head.obj"), text).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn the_memory_that_is_told_is_that_which_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    sound(folder.path(), 5);
    let marks = crate::model("default_head").join("landmarks.json");
    for (system, cuts) in [("freetalk", 0), ("freetalk", 1), ("cafe-talk", 0)] {
        head_cut(folder.path(), cuts);
        let face = ["--mesh", "head.obj", "--landmarks", marks.to_str().unwrap()];
        let job = [
            "animate",
            "--audio",
            "a.wav",
            "--out",
            "o.pc2",
            "--no-cache",
        ];
        let how = ["--system", system, "--report", "r.json"];
        let mut child = start(folder.path(), &[&job[..], &face, &how].concat());
        let mut peak_mb = 0;
        while child.try_wait().unwrap().is_none() {
            peak_mb = peak_mb.max(peak(child.id()) >> 20);
            std::thread::sleep(Duration::from_millis(2));
        }
        let report = fs::read_to_string(folder.path().join("r.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        let reported_mb = report["memory_mb"].as_u64().unwrap();
        let is_near = reported_mb.abs_diff(peak_mb) as f64 <= 0.4 * peak_mb as f64;
        assert!(
            is_near,
            "{system}, {cuts}: reported {reported_mb} MB, took {peak_mb} MB"
        );
    }
}

/// Four million vertices under a limit of address space that holds the mesh but not the work on it.
#[cfg(target_os = "linux")]
#[test]
fn a_mesh_whose_work_does_not_fit_is_refused_before_it_is_done() {
    const VERTICES: usize = 4_000_000;
    let folder = tempfile::tempdir().unwrap();
    sound(folder.path(), 1);
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {VERTICES}\nproperty float x\nproperty float y\n\
         property float z\nelement face 8\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for v in 0..VERTICES {
        for x in [v % 7, v % 5, v % 3] {
            ply.extend((x as f32).to_le_bytes());
        }
    }
    for first in 0..8i32 {
        ply.push(3);
        (first..first + 3).for_each(|v| ply.extend(v.to_le_bytes()));
    }
    fs::write(folder.path().join("m.ply"), ply).unwrap();
    let line =
        "ulimit -v 1500000; exec \"$0\" animate --mesh m.ply --audio a.wav --out o.pc2 --no-cache";
    let output = Command::new("bash")
        .args(["-c", line, env!("CARGO_BIN_EXE_anyface")])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(13), "{message}");
    assert!(
        message.contains("4000000 vertices take about 2"),
        "{message}"
    );
}
