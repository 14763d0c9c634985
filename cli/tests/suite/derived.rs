//! Results whose names nobody typed: they replace what the command wrote, and nothing else.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use tempfile::TempDir;

use crate::{folder_with_sound, model, voice::babble};

const DONE: i32 = 0;
const INVALID_INPUT: i32 = 3;
const OF_THE_USER: &[u8] = b"the work of a day";

/// A command, and each file that it would write under a derived name.
const KINDS: [(&str, &[&str]); 17] = [
    ("animate HEAD --audio a.wav --out take.glb", &["take.wav"]),
    ("animate HEAD --audio a.wav --out take.usda", &["take.wav"]),
    (
        "animate HEAD --audio a.wav --out o.npz --system emoface --layers content,emotion",
        &["o_content.npz", "o_emotion.npz"],
    ),
    (
        "animate HEAD --audio a.wav --out o.npz --open-mouth",
        &["o_open_mouth.obj", "o_open_mouth.landmarks.json"],
    ),
    ("open-mouth HEAD --out o.obj", &["o.landmarks.json"]),
    ("open-eyes HEAD --out o.obj", &["o.landmarks.json"]),
    ("head --seed 7 --out h.obj", &["h.landmarks.json"]),
    (
        "rig HEAD --out shapes",
        &[
            "shapes/neutral.obj",
            "shapes/jawOpen.obj",
            "shapes/viseme_aa.obj",
        ],
    ),
    (
        "rig HEAD --by field --in-betweens --out shapes",
        &["shapes/jawOpen_half.obj"],
    ),
    ("batch glb.csv HEAD", &["line.wav"]),
    ("batch usda.csv HEAD", &["line.wav"]),
    (
        "batch npz.csv",
        &[
            "npz.reports/history.jsonl",
            "npz.reports/batch.json",
            "npz.reports/results.html",
        ],
    ),
    (
        "batch npz.csv --export flamenco",
        &["npz.flamenco/anyface.js", "npz.flamenco/job.json"],
    ),
    (
        "batch npz.csv --export openjd",
        &["npz.openjd/template.yaml"],
    ),
    ("batch npz.csv --export slurm", &["npz.slurm/anyface.sh"]),
    (
        "batch npz.csv --export slurm --out jobs",
        &["jobs/anyface.sh"],
    ),
    ("batch npz.csv --export opencue", &["npz.opencue/submit.py"]),
];

fn folder() -> TempDir {
    let folder = folder_with_sound(&babble(0.4, 16_000), 16_000);
    for ending in ["glb", "usda", "npz"] {
        let table = format!("audio,out\na.wav,line.{ending}\n");
        fs::write(folder.path().join(format!("{ending}.csv")), table).unwrap();
    }
    folder
}

fn run(folder: &Path, line: &str, cache: &str) -> Output {
    let head = model("default_head");
    let [mesh, marks] = ["head.obj", "landmarks.json"].map(|name| head.join(name));
    let head = format!("--mesh {} --landmarks {}", mesh.display(), marks.display());
    let line = format!("{line} {cache}").replace("HEAD", &head);
    let mut command = Command::new(env!("CARGO_BIN_EXE_anyface"));
    let command = command.current_dir(folder).args(line.split_whitespace());
    command.output().unwrap()
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs a command over a file of the user, which it may refuse or pass by.
fn try_to_replace(line: &str, put: impl FnOnce(&Path) -> std::path::PathBuf) {
    let folder = folder();
    let file = put(folder.path());
    let output = run(folder.path(), line, "--cache cache");
    let code = output.status.code();
    let errors = errors(&output);
    assert!(
        [Some(DONE), Some(INVALID_INPUT)].contains(&code),
        "{line}: {errors}"
    );
    assert_eq!(fs::read(file).unwrap(), OF_THE_USER, "{line}: {errors}");
    if code == Some(INVALID_INPUT) {
        assert!(errors.contains("move it away"), "{line}: {errors}");
        for result in ["o.npz", "o.obj", "h.obj", "shapes/jawLeft.obj", "line.npz"] {
            assert!(!folder.path().join(result).exists(), "{line}: {result}");
        }
    }
}

#[test]
fn no_derived_name_replaces_a_file_of_the_user() {
    let mut kinds = 0;
    for (line, names) in KINDS {
        for name in names {
            try_to_replace(line, |folder| {
                let file = folder.join(name);
                fs::create_dir_all(file.parent().unwrap()).unwrap();
                fs::write(&file, OF_THE_USER).unwrap();
                file
            });
            kinds += 1;
        }
    }
    assert!(kinds >= 20, "{kinds}");
}

#[cfg(unix)]
#[test]
fn no_derived_name_is_written_through_a_link() {
    for (line, names) in KINDS {
        for name in names {
            try_to_replace(line, |folder| {
                let (link, file) = (folder.join(name), folder.join("archive"));
                fs::create_dir_all(link.parent().unwrap()).unwrap();
                fs::write(&file, OF_THE_USER).unwrap();
                std::os::unix::fs::symlink(&file, link).unwrap();
                file
            });
        }
    }
}

#[test]
fn what_the_command_wrote_is_replaced_and_what_somebody_changed_is_not() {
    let folder = folder();
    let landmarks = folder.path().join("h.landmarks.json");
    let head = |seed: u8, cache: &str| {
        let line = format!("head --seed {seed} --skin-only --out h.obj");
        let output = run(folder.path(), &line, cache);
        (output.status.code(), fs::read(&landmarks).unwrap())
    };
    let first = head(7, "--cache cache");
    let second = head(8, "--cache cache");
    assert_eq!((first.0, second.0), (Some(DONE), Some(DONE)));
    assert_ne!(first.1, second.1);
    // Without receipts nobody knows whose the file is.
    assert_eq!(head(9, "--no-cache").0, Some(INVALID_INPUT));
    fs::write(&landmarks, OF_THE_USER).unwrap();
    let third = head(9, "--cache cache");
    assert_eq!(third, (Some(INVALID_INPUT), OF_THE_USER.to_vec()));
}

#[test]
fn a_sound_beside_a_scene_gives_way_and_says_so() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let animate = "animate HEAD --audio a.wav --out take.glb";
    let works = |cache: &str| {
        let output = run(folder.path(), animate, cache);
        assert_eq!(output.status.code(), Some(DONE), "{}", errors(&output));
        errors(&output)
    };
    // The copy of before is the same sound, whoever wrote it.
    assert_eq!(works("--no-cache"), "");
    assert_eq!(works("--no-cache"), "");
    assert_eq!(
        fs::read(at("a.wav")).unwrap(),
        fs::read(at("take.wav")).unwrap()
    );
    fs::write(at("take.wav"), OF_THE_USER).unwrap();
    for _ in 0..2 {
        let told = works("--no-cache");
        assert!(
            told.contains("stays: the sound is in take.glb.wav"),
            "{told}"
        );
    }
    let scene = fs::read(at("take.glb")).unwrap();
    let name = b"\"take.glb.wav\"";
    assert!(scene.windows(name.len()).any(|bytes| bytes == name));
    assert_eq!(
        fs::read(at("a.wav")).unwrap(),
        fs::read(at("take.glb.wav")).unwrap()
    );
    fs::write(at("take.glb.wav"), OF_THE_USER).unwrap();
    let output = run(folder.path(), animate, "--no-cache");
    assert_eq!(output.status.code(), Some(INVALID_INPUT));
}

#[test]
fn an_animation_that_fails_leaves_no_sound() {
    let folder = folder();
    let flat = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    fs::write(folder.path().join("flat.obj"), flat).unwrap();
    let line = "animate --mesh flat.obj --audio a.wav --out take.glb";
    let output = run(folder.path(), line, "--no-cache");
    assert!(!output.status.success());
    assert!(!folder.path().join("take.wav").exists() && !folder.path().join("take.glb").exists());
}

#[test]
fn a_second_batch_replaces_its_own_pages() {
    let folder = folder();
    for words in ["", "--again", "--sum"] {
        let output = run(
            folder.path(),
            &format!("batch npz.csv {words}"),
            "--no-cache",
        );
        assert_eq!(output.status.code(), Some(DONE), "{}", errors(&output));
    }
    let exports = ["--chunk 1", "--chunk 2"];
    for words in exports {
        let line = format!("batch npz.csv --export slurm {words}");
        let output = run(folder.path(), &line, "--no-cache");
        assert_eq!(output.status.code(), Some(DONE), "{}", errors(&output));
    }
}

#[cfg(unix)]
#[test]
fn a_link_to_another_folder_is_told() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("archive")).unwrap();
    fs::write(at("archive/m.npz"), OF_THE_USER).unwrap();
    std::os::unix::fs::symlink("archive/m.npz", at("out.npz")).unwrap();
    let line = "motion --audio a.wav --out out.npz";
    let told = errors(&run(folder.path(), line, "--no-cache"));
    assert!(
        told.contains("is a link: the result is written to"),
        "{told}"
    );
    assert_ne!(fs::read(at("archive/m.npz")).unwrap(), OF_THE_USER);
}

#[test]
fn landmarks_that_are_read_without_a_word_are_not_replaced() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let head = model("default_head");
    fs::copy(head.join("head.obj"), at("m.obj")).unwrap();
    fs::copy(head.join("landmarks.json"), at("m.landmarks.json")).unwrap();
    let by_hand = fs::read(at("m.landmarks.json")).unwrap();
    fs::write(at("t.csv"), "audio,out\na.wav,m.landmarks.json\n").unwrap();
    for line in [
        "animate --mesh m.obj --audio a.wav --out o.npz --report m.landmarks.json",
        "open-mouth --mesh m.obj --out m.OBJ",
        "open-eyes --mesh m.obj --out ./m.OBJ",
        "rig --mesh m.obj --out r.npz --report m.landmarks.json",
        "batch t.csv --mesh m.obj",
    ] {
        let output = run(folder.path(), line, "--no-cache");
        assert!(!output.status.success(), "{line}");
        assert_eq!(fs::read(at("m.landmarks.json")).unwrap(), by_hand, "{line}");
    }
    // This command is there to make the file.
    let line = "landmarks --mesh m.obj --out m.landmarks.json";
    let output = run(folder.path(), line, "--no-cache");
    assert_eq!(output.status.code(), Some(DONE), "{}", errors(&output));
}

#[test]
fn a_result_that_cannot_have_its_name_leaves_no_other() {
    let folder = folder();
    let long = "n".repeat(300);
    for (report, word) in [
        (
            "",
            "--report: expected the name of a file, got an empty one",
        ),
        ("no-folder/", "regular file"),
        (long.as_str(), "too long"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_anyface"));
        let words = ["motion", "--audio", "a.wav", "--out", "o.npz", "--report"];
        let command = command.current_dir(folder.path()).args(words).arg(report);
        let output = command.output().unwrap();
        let errors = errors(&output);
        assert!(
            !output.status.success() && errors.contains(word),
            "{errors}"
        );
        assert!(!folder.path().join("o.npz").exists(), "{report}");
    }
}

#[test]
fn a_folder_of_the_user_is_no_cache() {
    let folder = folder();
    let film = folder.path().join("dl/film.mkv.part");
    fs::create_dir(folder.path().join("dl")).unwrap();
    let file = fs::File::create(&film).unwrap();
    file.set_modified(std::time::SystemTime::UNIX_EPOCH)
        .unwrap();
    let output = run(
        folder.path(),
        "motion --audio a.wav --out o.npz",
        "--cache dl",
    );
    assert_eq!(output.status.code(), Some(INVALID_INPUT));
    let errors = errors(&output);
    assert!(errors.contains("which holds film.mkv.part"), "{errors}");
    assert!(film.exists() && !folder.path().join("o.npz").exists());
}
