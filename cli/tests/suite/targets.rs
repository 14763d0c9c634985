//! Morph targets that the file of a mesh has already: none is made twice, and they can be driven.

use std::{collections::BTreeSet, fs, path::Path, process::Command};

use serde_json::Value;

use crate::{folder_with_sound, model, voice::babble};

/// Runs the command with `--json` in a folder and returns what it printed.
fn run(folder: &Path, line: &str) -> Value {
    let head = model("default_head");
    let marks = head.join("landmarks.json");
    let line = line
        .replace("HEAD", &head.join("head.obj").display().to_string())
        .replace("MARKS", &marks.display().to_string());
    let output = Command::new(env!("CARGO_BIN_EXE_anyface"))
        .current_dir(folder)
        .args(line.split_whitespace())
        .args(["--json", "--no-cache"])
        .output()
        .unwrap();
    let printed = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    let json = printed.iter().find(|text| text.starts_with('{'));
    serde_json::from_str(json.unwrap_or_else(|| panic!("{line}: {printed:?}"))).unwrap()
}

/// The description of a GLB.
fn description(path: &Path) -> Value {
    let bytes = fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

fn target_names(path: &Path) -> Vec<String> {
    let names = &description(path)["meshes"][0]["extras"]["targetNames"];
    serde_json::from_value(names.clone()).unwrap()
}

#[test]
fn targets_of_a_file_are_never_made_twice_and_can_be_driven() {
    let folder = folder_with_sound(&babble(0.6, 16_000), 16_000);
    let folder = folder.path();
    let animate = |mesh: &str, targets: &str, out: &str| {
        let line = format!(
            "animate --mesh {mesh} --landmarks MARKS --audio a.wav --targets {targets} --out {out}"
        );
        run(folder, &line)
    };
    animate("HEAD", "arkit", "one.glb");
    let made = target_names(&folder.join("one.glb"));
    let unique: BTreeSet<&String> = made.iter().collect();
    assert!(unique.len() == made.len() && made.len() > 45);
    animate("one.glb", "arkit", "two.glb");
    assert_eq!(target_names(&folder.join("two.glb")), made);
    let report = animate("one.glb", "own", "own.glb");
    assert_eq!(target_names(&folder.join("own.glb")), made);
    let targets = &report["targets"];
    assert_eq!(targets["tool"], "ARKit");
    assert_eq!(targets["names"].as_array().unwrap().len(), made.len());
    let share = targets["share_of_mouth"].as_f64().unwrap();
    assert!(share > 0.85, "{share}");
    let animations = |name: &str| description(&folder.join(name))["animations"].clone();
    assert_eq!(animations("own.glb").as_array().unwrap().len(), 2);
    let error = animate("HEAD", "own", "none.glb");
    let message = error["error"].to_string();
    assert!(message.contains("--targets arkit"), "{error}");
}
