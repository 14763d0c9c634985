//! Runs the examples of `capi/examples`, since readers copy them.

use std::{path::Path, process::Command};

use anyface_tests::native::{Linkage, command, compile, root, run, succeed};

use crate::{scene, workspace};

const TALK_C: &str = "capi/examples/talk.c";
const TALK_CPP: &str = "capi/examples/talk.cpp";
const EVENTS_C: &str = "capi/examples/events.c";
const LIVE_C: &str = "capi/examples/live.c";
const HEAD_C: &str = "capi/examples/head.c";
const TAKES_C: &str = "capi/examples/takes.c";

fn in_folder(program: &Path, folder: &Path) -> Command {
    let mut command = command(program);
    command
        .current_dir(folder)
        .env("XDG_CACHE_HOME", folder.join("cache"));
    command
}

/// The header of a pc2 file: vertices and frames.
fn pc2_counts(path: &Path) -> (u32, u32) {
    let bytes = std::fs::read(path).expect("the program wrote its file");
    assert_eq!(&bytes[..12], b"POINTCACHE2\0");
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let (vertices, frames) = (number(16), number(28));
    assert_eq!(bytes.len() as u32, 32 + 12 * vertices * frames);
    (vertices, frames)
}

#[test]
fn the_c_example_makes_a_head_talk() {
    for linkage in [Linkage::Shared, Linkage::Static] {
        let folder = workspace(&format!("talk_c {linkage:?}"));
        scene(&folder);
        let program = compile(TALK_C, linkage, &folder);
        let mut command = in_folder(&program, &folder);
        command.args([
            "head.obj",
            "voice.wav",
            "out.pc2",
            "happy:0.7",
            "landmarks.json",
        ]);
        let output = succeed(&mut command);
        let (vertices, frames) = pc2_counts(&folder.join("out.pc2"));
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            said.starts_with(&format!("frames {frames} vertices {vertices} fps 30")),
            "{said}"
        );
        // 0.6 s at 30 frames a second.
        assert!((17..=20).contains(&frames), "{frames}");
        let largest: f32 = said.trim().rsplit(' ').next().unwrap().parse().unwrap();
        // Centimetres: a mouth moves by millimetres, not by metres.
        assert!((0.01..5.0).contains(&largest), "{largest}");
    }
}

#[test]
fn the_c_example_says_what_is_wrong() {
    let folder = workspace("talk_c errors");
    scene(&folder);
    let program = compile(TALK_C, Linkage::Shared, &folder);
    let mut missing = in_folder(&program, &folder);
    let output = run(missing.args(["head.obj", "nothing.wav", "out.pc2"]), 8);
    assert!(String::from_utf8_lossy(&output.stderr).contains("nothing.wav"));
    let mut emotion = in_folder(&program, &folder);
    run(
        emotion.args([
            "head.obj",
            "voice.wav",
            "out.pc2",
            "joyful",
            "landmarks.json",
        ]),
        3,
    );
    let mut ending = in_folder(&program, &folder);
    run(
        ending.args(["head.obj", "voice.wav", "out.xyz", "", "landmarks.json"]),
        3,
    );
    assert!(!folder.join("out.pc2").exists() && !folder.join("out.xyz").exists());
}

#[test]
fn the_cpp_example_runs_a_job_beside_its_own_thread() {
    for linkage in [Linkage::Shared, Linkage::Static] {
        let folder = workspace(&format!("talk_cpp {linkage:?}"));
        scene(&folder);
        let program = compile(TALK_CPP, linkage, &folder);
        let mut command = in_folder(&program, &folder);
        let output = succeed(command.args(["head.obj", "voice.wav", "landmarks.json"]));
        let said = String::from_utf8(output.stdout).expect("the program prints text");
        let gaps: Vec<f32> = said
            .lines()
            .skip(1)
            .map(|line| line.parse().unwrap())
            .collect();
        // 0.6 s at 25 frames a second.
        assert!((14..=17).contains(&gaps.len()), "{said}");
        let range = gaps
            .iter()
            .fold([f32::MAX, f32::MIN], |[a, b], g| [a.min(*g), b.max(*g)]);
        assert!(
            range[1] - range[0] > 1e-3,
            "the lips never move: {range:?} cm"
        );
    }
}

#[test]
fn the_cpp_example_can_be_cancelled() {
    let folder = workspace("talk_cpp cancelled");
    scene(&folder);
    let program = compile(TALK_CPP, Linkage::Shared, &folder);
    let mut command = in_folder(&program, &folder);
    // With a minute of voice, the job is still running when the program first looks at the clock.
    anyface_tests::scene::Scene::write(&folder, 60.0).expect("the scene can be written");
    let output = run(
        command.args(["head.obj", "voice.wav", "landmarks.json", "0"]),
        9,
    );
    assert!(String::from_utf8_lossy(&output.stderr).contains("cancelled"));
}

#[test]
fn the_example_of_events_writes_the_weights_of_the_system() {
    for linkage in [Linkage::Shared, Linkage::Static] {
        let folder = workspace(&format!("events_c {linkage:?}"));
        scene(&folder);
        let program = compile(EVENTS_C, linkage, &folder);
        let mut command = in_folder(&program, &folder);
        let output = succeed(command.args(["voice.wav", "out.csv"]));
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let count = |said: &str| said.matches("start_s").count();
        assert!(said.contains("shapes 51") && count(&said) == 2, "{said}");
        let table = std::fs::read_to_string(folder.join("out.csv")).expect("the table is there");
        let rows: Vec<&str> = table.lines().collect();
        assert!(rows[0].contains("BrowInnerUp") && (18..=21).contains(&rows.len()));
        // An event in the notation of the command line.
        let mut words = in_folder(&program, &folder);
        let output = succeed(words.args(["voice.wav", "out.csv", "0.2-0.5:left wink:0.8"]));
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(said.contains("45L") && count(&said) == 1, "{said}");
        let mut wrong = in_folder(&program, &folder);
        let event = r#"[{"start_s": 0.2, "end_s": 0.1, "units": ["45L"]}]"#;
        let output = run(wrong.args(["voice.wav", "none.csv", event]), 3);
        assert!(String::from_utf8_lossy(&output.stderr).contains("event 1"));
        assert!(!folder.join("none.csv").exists());
    }
}

#[test]
fn the_live_example_follows_raw_sound() {
    let folder = workspace("live_c");
    scene(&folder);
    let program = compile(LIVE_C, Linkage::Shared, &folder);
    // After its header, a WAV file of these tests holds the raw samples that a microphone would
    // deliver.
    let wav = std::fs::read(folder.join("voice.wav")).expect("the scene has a voice");
    std::fs::write(folder.join("voice.raw"), &wav[44..]).expect("the folder can be written");
    let sound = std::fs::File::open(folder.join("voice.raw")).expect("it was written");
    let mut command = in_folder(&program, &folder);
    let output = succeed(command.args(["happy", "any"]).stdin(sound));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let lines: Vec<&str> = said.lines().collect();
    assert!(lines.len() >= 15, "{said}");
    assert!(
        said.contains("mouthSmileLeft=") && said.contains("viseme_"),
        "{said}"
    );
    let last = lines[lines.len() - 1];
    assert!(last.starts_with(&(lines.len() - 1).to_string()), "{last}");
    let sound = std::fs::File::open(folder.join("voice.raw")).expect("it was written");
    let mut command = in_folder(&program, &folder);
    let heard = succeed(command.args(["auto", "soon"]).stdin(sound));
    let late = String::from_utf8_lossy(&heard.stderr).into_owned();
    assert!(
        late.contains("frames come 72 ms late") || late.contains("73 ms"),
        "{late}"
    );
    let heard = String::from_utf8_lossy(&heard.stdout).into_owned();
    assert_eq!(heard.lines().count(), lines.len());
}

#[test]
fn the_example_of_heads_writes_one() {
    for linkage in [Linkage::Shared, Linkage::Static] {
        let folder = workspace(&format!("head_c {linkage:?}"));
        let program = compile(HEAD_C, linkage, &folder);
        let mut command = in_folder(&program, &folder);
        let output = succeed(command.args(["7", "head.obj", "12", "1.5"]));
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(said.contains("vertices"), "{said}");
        let text = std::fs::read_to_string(folder.join("head.obj")).expect("the mesh is there");
        let lines = |start: &str| text.lines().filter(|line| line.starts_with(start)).count();
        assert!(lines("v ") > 5000 && lines("f ") > 10_000, "{said}");
        let numbers = text.lines().next().expect("the first line").split(' ');
        assert_eq!(numbers.count(), 113);
        let quads = text.lines().filter(|line| line.split(' ').count() == 5);
        assert!(quads.count() > 4000, "skin is quads");
        let mut wrong = in_folder(&program, &folder);
        let output = run(wrong.args(["7", "none.obj", "12", "9"]), 3);
        assert!(String::from_utf8_lossy(&output.stderr).contains("-4 to 4"));
        assert!(!folder.join("none.obj").exists());
    }
}

#[test]
fn the_example_of_takes_hears_once_and_streams_the_frames() {
    let folder = workspace("takes_c");
    anyface_tests::scene::Scene::write(&folder, 1.6).expect("the scene can be written");
    let program = compile(TAKES_C, Linkage::Shared, &folder);
    let mut command = in_folder(&program, &folder);
    let output = succeed(command.args(["head.obj", "voice.wav", "0.4", "1.0"]));
    let said = String::from_utf8(output.stdout).expect("the program prints text");
    let lines: Vec<&str> = said.lines().collect();
    let lip = |line: &str| line.split(' ').nth_back(1).unwrap().parse::<f32>().unwrap();
    assert!(
        lip(lines[1]) > lip(lines[0]),
        "wider lips go further: {said}"
    );
    let last: Vec<&str> = lines[3].split(' ').collect();
    let [frames, vertices] = [2, 4].map(|at| last[at].parse::<u64>().unwrap());
    // A second of the recording at 30 frames a second.
    assert!((28..=32).contains(&frames), "{said}");
    let bytes = std::fs::metadata(folder.join("mixed.raw"))
        .expect("the frames are there")
        .len();
    assert_eq!(bytes, 12 * frames * vertices);
    let size = |name: &str| std::fs::metadata(folder.join(name)).map_or(0, |file| file.len());
    assert!(
        ["first.npz", "again.npz", "mixed.npz", "found.json"]
            .iter()
            .all(|name| size(name) > 0)
    );
    let mut wrong = in_folder(&program, &folder);
    run(wrong.args(["head.obj", "voice.wav", "9", "1.0"]), 4);
}

/// The program and the functions in `docs/c-host.md` compile exactly as printed.
#[test]
fn the_page_for_hosts_compiles() {
    let page = std::fs::read_to_string(root().join("docs/c-host.md")).expect("the page is there");
    let blocks = page.split("```c\n").skip(1);
    let blocks: Vec<&str> = blocks.filter_map(|rest| rest.split("```").next()).collect();
    assert!(blocks.len() > 3, "{blocks:?}");
    let folder = workspace("page");
    let source = folder.join("page.c");
    let main = "int main(void) { return talk(0, 0, 0, 0, 0, 0, 0) != ANYFACE_STATUS_MESH; }\n";
    let text = format!("{}\n{main}", blocks.join("\n"));
    std::fs::write(&source, text).expect("the source can be written");
    let path = source.to_str().expect("the target folder's name is UTF-8");
    let program = compile(path, Linkage::Shared, &folder);
    succeed(&mut in_folder(&program, &folder));
}

/// There is no leak and no invalid access from the first call to the last free.
#[test]
#[cfg_attr(not(has_valgrind), ignore = "needs valgrind")]
fn the_c_example_is_clean_under_valgrind() {
    let folder = workspace("valgrind");
    anyface_tests::scene::Scene::write(&folder, 0.3).expect("the scene can be written");
    let program = compile(TALK_C, Linkage::Shared, &folder);
    let mut command = in_folder(Path::new("valgrind"), &folder);
    command.args([
        "--quiet",
        "--leak-check=full",
        "--show-leak-kinds=definite,indirect",
    ]);
    command.args([
        "--errors-for-leak-kinds=definite,indirect",
        "--error-exitcode=99",
    ]);
    command.arg(program);
    command.args([
        "head.obj",
        "voice.wav",
        "out.npz",
        "happy:0.7",
        "landmarks.json",
    ]);
    succeed(&mut command);
}
