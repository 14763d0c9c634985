//! `anyface batch` from outside: the results of a row, which rows are done again, and what a broken row
//! prevents.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    time::{Duration, Instant},
};

use anyface::{
    mesh::Mesh,
    output::{read_landmark_motion, read_rig, read_vertex_motion},
};
use serde_json::Value;
use tempfile::TempDir;

use crate::{folder_with_sound, model, voice::intoned};

const SOME_FAILED: i32 = 12;
const INVALID_INPUT: i32 = 3;

fn anyface(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_anyface"));
    command
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

fn done(output: &Output, code: i32) -> String {
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    let results = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(code), "{errors}{results}");
    errors + &results
}

/// A folder with a short voice in `a.wav` and these rows in `lines.csv`.
fn folder(seconds: f32, lines: &str) -> TempDir {
    let folder = folder_with_sound(&intoned(seconds, 16_000), 16_000);
    write(&folder, "lines.csv", lines);
    folder
}

fn write(folder: &TempDir, name: &str, text: &str) {
    fs::write(folder.path().join(name), text).unwrap();
}

/// Every line of the history.
fn history(folder: &Path) -> Vec<Value> {
    let text = fs::read_to_string(folder.join("lines.reports/history.jsonl")).unwrap_or_default();
    let lines = text.lines().filter(|line| !line.is_empty());
    lines
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

fn summary(folder: &Path) -> Value {
    let text = fs::read_to_string(folder.join("lines.reports/batch.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn modified(path: PathBuf) -> std::time::SystemTime {
    fs::metadata(path).unwrap().modified().unwrap()
}

/// The columns of a table of weights, by name.
fn table(path: &Path) -> BTreeMap<String, Vec<f32>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let names: Vec<String> = reader
        .headers()
        .unwrap()
        .iter()
        .map(str::to_owned)
        .collect();
    let mut columns: BTreeMap<String, Vec<f32>> = BTreeMap::new();
    for record in reader.records() {
        for (name, cell) in names.iter().zip(record.unwrap().iter()).skip(2) {
            let column = columns.entry(name.clone()).or_default();
            column.push(cell.parse().unwrap());
        }
    }
    columns
}

#[test]
fn a_row_gives_the_weights_that_animate_and_solve_give() {
    let folder = folder(
        1.5,
        "audio,out,emotion,seed\na.wav,w.csv,off,3\na.wav,t.npz,off,3\n",
    );
    let head = model("default_head");
    let (mesh, landmarks) = (head.join("head.obj"), head.join("landmarks.json"));
    let face = [
        "--mesh",
        mesh.to_str().unwrap(),
        "--landmarks",
        landmarks.to_str().unwrap(),
    ];
    let run = |words: &[&str]| done(&anyface(folder.path(), words), 0);
    run(&[&["batch", "lines.csv"][..], &face].concat());
    let animate = [
        "animate",
        "--audio",
        "a.wav",
        "--out",
        "a.npz",
        "--emotion",
        "off",
        "--seed",
        "3",
    ];
    run(&[&animate[..], &face].concat());
    run(&[&["rig", "--out", "rig.npz"][..], &face].concat());
    let solve = [
        "solve",
        "--animation",
        "a.npz",
        "--rig",
        "rig.npz",
        "--out",
        "s.csv",
    ];
    run(&[&solve[..], &face].concat());
    let at = |name: &str| folder.path().join(name);
    let head = Mesh::read(&mesh).unwrap();
    let motion = |name: &str| read_vertex_motion(&at(name), &head).unwrap().displacements;
    let (ours, theirs) = (motion("t.npz"), motion("a.npz"));
    assert_eq!(ours.dim(), theirs.dim());
    let apart = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f32::max) < 1e-6);
    let (ours, theirs) = (table(&at("w.csv")), table(&at("s.csv")));
    assert_eq!(ours.len(), 61);
    let rig = read_rig(&at("rig.npz")).unwrap();
    let mut moves = 0.0f32;
    for (name, shape) in rig.names.iter().zip(rig.deltas.outer_iter()).take(52) {
        let column = name[..1].to_uppercase() + &name[1..];
        let largest_mm = shape.iter().fold(0.0f32, |most, x| most.max(x.abs())) * 1e3;
        for (a, b) in ours[&column].iter().zip(&theirs[&column]) {
            assert!((a - b).abs() < 2e-3, "{name}: {a} and {b}");
            assert!((a - b).abs() * largest_mm < 0.01, "{name}: {a} and {b}");
            moves = moves.max(*a);
        }
    }
    assert!(moves > 0.1, "{moves}");
}

#[test]
fn a_table_of_a_spreadsheet_makes_the_folders_of_its_results() {
    let folder = folder(0.4, "");
    let text = "audio;out;#note\na.wav;deep/er/1.npz;\u{e9}\n;;\n";
    let utf_16: Vec<u8> = format!("\u{feff}{text}")
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    fs::write(folder.path().join("lines.csv"), utf_16).unwrap();
    done(&anyface(folder.path(), &["batch", "lines.csv"]), 0);
    assert!(folder.path().join("deep/er/1.npz").is_file());
    assert_eq!(summary(folder.path())["ok"], 1);
    let single = ["motion", "--audio", "a.wav", "--out", "no/where/1.npz"];
    let errors = done(&anyface(folder.path(), &single), 8);
    assert!(
        errors.contains("no/where: this folder of --out is missing; make it first"),
        "{errors}"
    );
}

#[test]
fn finished_rows_are_not_done_again_until_something_changes() {
    let folder = folder(0.4, "audio,out,seed\na.wav,1.npz,1\na.wav,2.npz,2\n");
    let at = |name: &str| folder.path().join(name);
    let run = |more: &[&str]| {
        let words = [&["batch", "lines.csv", "--json"][..], more].concat();
        let output = anyface(folder.path(), &words);
        done(&output, 0);
        let value: Value = serde_json::from_slice(&output.stdout).unwrap();
        ["done", "finished_before", "ok"].map(|key| value[key].as_u64().unwrap())
    };
    assert_eq!(run(&[]), [2, 0, 2]);
    let first = modified(at("1.npz"));
    assert_eq!(run(&[]), [0, 2, 2]);
    assert_eq!(modified(at("1.npz")), first);
    write(
        &folder,
        "lines.csv",
        "audio,out,seed\na.wav,1.npz,1\na.wav,2.npz,5\n",
    );
    assert_eq!(run(&[]), [1, 1, 2]);
    fs::remove_file(at("1.npz")).unwrap();
    assert_eq!(run(&[]), [1, 1, 2]);
    fs::write(at("2.npz"), b"somebody else's").unwrap();
    assert_eq!(run(&[]), [1, 1, 2]);
    assert_eq!(run(&["--again", "--rows", "2"]), [1, 0, 2]);
    assert_eq!(run(&["--blinks", "40"]), [2, 0, 2]);
    fs::write(at("a.wav"), fs::read(at("a.wav")).unwrap()).unwrap();
    assert_eq!(run(&["--blinks", "40"]), [2, 0, 2]);
    let plain = [
        "motion", "--audio", "a.wav", "--out", "m.npz", "--seed", "5", "--blinks", "40",
    ];
    done(&anyface(folder.path(), &plain), 0);
    let motion = |name: &str| read_landmark_motion(&at(name)).unwrap().displacements;
    assert_eq!(motion("2.npz"), motion("m.npz"));
}

#[test]
fn a_broken_row_fails_alone_with_its_reason() {
    let rows = "name,audio,out,emotion,#note\n\
                good,a.wav,good.npz,happy:0.5,\"fine, this one\"\n\
                word,a.wav,word.npz,joyful:1,\n\
                gone,gone.wav,gone.npz,,\n\
                one,a.wav,same.npz,,\n\
                two,a.wav,./same.npz,,\n\
                self,self.npz,./self.npz,,\n\
                long,a.wav,long.npz,,,,,\n\
                kind,a.wav,kind.txt,,\n\
                last,a.wav,last.npz,,\n";
    let folder = folder(0.4, rows);
    let sound = fs::read(folder.path().join("a.wav")).unwrap();
    let errors = done(
        &anyface(folder.path(), &["batch", "lines.csv"]),
        SOME_FAILED,
    );
    for (name, words) in [
        ("word", "expected one of neutral, happy"),
        ("gone", "gone.wav"),
        ("one", "row 5 writes it, too"),
        ("two", "row 4 writes it, too"),
        ("self", "expected another file than one that is read"),
        ("long", "expected 5 cells as in the header, got 8"),
        ("kind", "expected a name that ends in .npz"),
    ] {
        let entry = history(folder.path());
        let entry = entry.iter().find(|entry| entry["name"] == name).unwrap();
        let message = entry["message"].as_str().unwrap();
        assert!(
            entry["ok"] == false && message.contains(words),
            "{name}: {message}"
        );
        assert!(errors.contains(message), "{errors}");
    }
    let at = |name: &str| folder.path().join(name);
    assert!(at("good.npz").exists() && at("last.npz").exists() && !at("same.npz").exists());
    assert_eq!(fs::read(at("a.wav")).unwrap(), sound);
    let sum = summary(folder.path());
    assert_eq!(
        (sum["ok"].as_u64(), sum["failed"].as_array().unwrap().len()),
        (Some(2), 7)
    );
    let page = fs::read_to_string(at("lines.reports/results.html")).unwrap();
    assert!(page.contains("\"name\":\"gone\"") && !page.contains("{{ROWS}}"));
}

#[test]
fn a_table_that_is_none_is_refused_before_anything_is_written() {
    for (lines, words) in [
        ("", "columns audio and out"),
        ("audio,seed\na.wav,1\n", "columns audio and out"),
        ("audio,out,moood\na.wav,o.npz,happy\n", "column \"moood\""),
    ] {
        let folder = folder(0.2, lines);
        let errors = done(
            &anyface(folder.path(), &["batch", "lines.csv"]),
            INVALID_INPUT,
        );
        assert!(errors.contains(words), "{errors}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
    let folder = folder(0.2, "audio,out\na.wav,o.npz\n");
    let output = anyface(folder.path(), &["batch", "lines.csv", "--rows", "2-3"]);
    assert!(done(&output, INVALID_INPUT).contains("expected some of 1 rows"));
}

#[test]
fn a_dry_run_says_what_would_be_done_and_writes_nothing() {
    let folder = folder(
        0.4,
        "audio,out,emotion\na.wav,1.npz,\na.wav,2.npz,joyful:1\ngone.wav,3.npz,\n",
    );
    let words = ["batch", "lines.csv", "--dry-run", "--json"];
    let output = anyface(folder.path(), &words);
    done(&output, SOME_FAILED);
    let plan: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (plan["rows"].as_u64(), plan["waiting"].as_u64()),
        (Some(3), Some(1))
    );
    assert_eq!(plan["broken"].as_array().unwrap().len(), 2);
    assert!(plan["estimated_s"].as_f64().unwrap() > 0.0);
    assert!(plan["estimated_mb"].as_u64().unwrap() > 10);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn paths_of_another_machine_are_translated() {
    let folder = folder(0.3, "");
    let here = folder.path().to_str().unwrap().to_owned();
    let rows =
        "audio,out\nP:\\show\\a.wav,P:\\show\\new.npz\n/other/a.wav,sub\\b.npz\nQ:\\a.wav,c.npz\n";
    write(&folder, "lines.csv", rows);
    fs::create_dir(folder.path().join("sub")).unwrap();
    let maps = [format!("P:\\show={here}"), format!("/other={here}")];
    let words = ["batch", "lines.csv", "--map", &maps[0], "--map", &maps[1]];
    if cfg!(windows) {
        return;
    }
    let errors = done(&anyface(folder.path(), &words), SOME_FAILED);
    assert!(errors.contains("--map Q:=FOLDER"), "{errors}");
    assert!(folder.path().join("new.npz").exists() && folder.path().join("sub/b.npz").exists());
}

fn started(folder: &Path, more: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_anyface"));
    command
        .current_dir(folder)
        .args(["batch", "lines.csv"])
        .args(more);
    command.stderr(Stdio::null()).stdout(Stdio::null());
    command.spawn().unwrap()
}

/// `count` rows with the same sound.
fn many(count: usize) -> String {
    let rows = (1..=count).map(|n| format!("a.wav,{n}.npz,{n}\n"));
    "audio,out,seed\n".to_owned() + &rows.collect::<String>()
}

/// Waits until the history has this many lines.
fn wait_for(folder: &Path, lines: usize) {
    let path = folder.join("lines.reports/history.jsonl");
    let end = Instant::now() + Duration::from_secs(120);
    while Instant::now() < end {
        let text = fs::read_to_string(&path).unwrap_or_default();
        if text.matches('\n').count() >= lines {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no {lines} lines in {}", path.display());
}

#[test]
fn a_killed_batch_goes_on_where_it_was() {
    let folder = folder(1.0, &many(40));
    let at = |n: u64| folder.path().join(format!("{n}.npz"));
    let mut child = started(folder.path(), &["--threads", "1"]);
    wait_for(folder.path(), 3);
    child.kill().unwrap();
    child.wait().unwrap();
    let before = history(folder.path()).len();
    assert!((3..40).contains(&before), "{before}");
    let first = modified(at(1));
    done(&anyface(folder.path(), &["batch", "lines.csv"]), 0);
    assert_eq!(modified(at(1)), first);
    assert!((1..=40).all(|n| at(n).exists()));
    let sum = summary(folder.path());
    assert_eq!(sum["finished_before"].as_u64().unwrap() as usize, before);
    assert_eq!(
        (sum["ok"].as_u64(), sum["left"].as_u64()),
        (Some(40), Some(0))
    );
}

#[cfg(unix)]
#[test]
fn an_interrupted_batch_ends_with_9_and_keeps_what_is_finished() {
    let folder = folder(1.0, &many(40));
    let mut child = started(folder.path(), &["--threads", "1"]);
    wait_for(folder.path(), 2);
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(child.wait().unwrap().code(), Some(9));
    let ends = history(folder.path());
    assert!(ends.len() < 40 && ends.iter().all(|end| end["ok"] == true));
    let sum = summary(folder.path());
    assert_eq!(sum["left"].as_u64().unwrap() as usize, 40 - ends.len());
    let left = fs::read_dir(folder.path()).unwrap().flatten();
    let mut parts = left.filter(|file| file.file_name().to_string_lossy().ends_with(".part"));
    assert!(parts.next().is_none());
}

#[test]
fn two_processes_share_the_rows_of_one_table() {
    let folder = folder(0.5, &many(16));
    let halves = [["--rows", "1-8"], ["--rows", "9-16"]];
    let mut children = halves.map(|half| started(folder.path(), &half));
    for child in &mut children {
        assert!(child.wait().unwrap().success());
    }
    let ends = history(folder.path());
    assert_eq!(ends.len(), 16);
    let output = anyface(folder.path(), &["batch", "lines.csv", "--json"]);
    done(&output, 0);
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (value["ok"].as_u64(), value["done"].as_u64()),
        (Some(16), Some(0))
    );
}

/// Exports three rows for an engine, with up to two rows a task.
fn export(folder: &TempDir, engine: &str) -> String {
    write(
        folder,
        "lines.csv",
        "audio,out\na.wav,1.npz\na.wav,2.npz\na.wav,3.npz\n",
    );
    let words = ["batch", "lines.csv", "--export", engine, "--chunk", "2"];
    let more = ["--seed", "7", "--map", "/a b=/c", "--no-cache"];
    done(&anyface(folder.path(), &[&words[..], &more].concat()), 0)
}

#[cfg(unix)]
#[test]
fn tasks_of_an_exported_array_do_all_rows_and_the_last_one_writes_the_page() {
    let folder = folder(0.4, "");
    let said = export(&folder, "slurm");
    assert!(said.contains("3 rows, 2 a task"), "{said}");
    let exported = folder.path().join("lines.slurm/anyface.sh");
    assert!(said.contains(exported.to_str().unwrap()), "{said}");
    assert!(!folder.path().join("lines.reports").exists());
    let script = |words: &[&str], task: &str| {
        let mut command = Command::new("bash");
        command.arg(&exported).args(words);
        command.env("SLURM_ARRAY_TASK_ID", task);
        done(&command.current_dir("/").output().unwrap(), 0)
    };
    script(&[], "2");
    let page = folder.path().join("lines.reports/results.html");
    assert!(!page.exists(), "a part of the rows writes no page");
    script(&[], "1");
    let ends = history(folder.path());
    assert!(ends.len() == 3 && ends.iter().all(|end| end["ok"] == true));
    script(&["sum"], "0");
    assert!(page.exists());
    assert_eq!(summary(folder.path())["ok"].as_u64(), Some(3));
    // The command finds that the engine has done the same rows.
    let words = ["batch", "lines.csv", "--seed", "7", "--no-cache"];
    let said = done(&anyface(folder.path(), &words), 0);
    assert!(said.contains("0 done now"), "{said}");
}

#[test]
fn an_export_fills_in_every_placeholder_and_quotes_what_it_fills_in() {
    let folder = folder(0.4, "");
    for (engine, file) in [
        ("flamenco", "job.json"),
        ("openjd", "template.yaml"),
        ("slurm", "anyface.sh"),
        ("opencue", "submit.py"),
    ] {
        export(&folder, engine);
        let folder = folder.path().join(format!("lines.{engine}"));
        let text = fs::read_to_string(folder.join(file)).unwrap();
        for placeholder in [
            "program",
            "arguments",
            "rows",
            "chunk",
            "cores",
            "memory_mb",
        ] {
            assert!(!text.contains(&format!("{{{{{placeholder}}}}}")), "{text}");
        }
        let quoted = match engine {
            "slurm" => "'--map=/a b=/c'",
            "flamenco" => "'--map=/a b=/c'",
            _ => "\"--map=/a b=/c\"",
        };
        assert!(text.contains(quoted), "{text}");
        if engine == "flamenco" {
            let job: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(job["settings"]["rows"].as_u64(), Some(3));
            assert_eq!(job["settings"]["chunk_size"].as_u64(), Some(2));
            assert!(folder.join("anyface.js").exists());
        }
    }
}

#[test]
fn an_export_that_cannot_be_right_is_refused() {
    let folder = folder(0.4, "audio,out\n");
    let refused = |words: &[&str], code: i32, why: &str| {
        let errors = done(
            &anyface(folder.path(), &[&["batch", "lines.csv"], words].concat()),
            code,
        );
        assert!(errors.contains(why), "{errors}");
    };
    let usage = 2;
    refused(
        &["--export", "slurm"],
        INVALID_INPUT,
        "expected rows to export, got none",
    );
    refused(&["--export", "deadline"], usage, "openjd");
    refused(
        &["--export", "slurm", "--rows", "1-2"],
        usage,
        "cannot be used with",
    );
    refused(
        &["--export", "slurm", "--memory", "0"],
        usage,
        "expected more than 0 GB",
    );
    refused(&["--chunk", "3"], usage, "--export");
    write(&folder, "lines.csv", "audio,out\na.wav,1.npz\n");
    let words = ["--export", "openjd", "--map", "/{{a=/b"];
    refused(&words, INVALID_INPUT, "Open Job Description");
}
