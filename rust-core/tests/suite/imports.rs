//! The layers of ARCHITECTURE.md, held against the sources.

use std::{fs, path::Path};

const BELOW_SYSTEMS: [&str; 7] = [
    "nn",
    "diffusion",
    "operators",
    "mesh",
    "motion",
    "audio",
    "deform",
];

fn sources(folder: &Path) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push((
                path.display().to_string(),
                fs::read_to_string(&path).unwrap(),
            ));
        }
    }
    found
}

fn src() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

#[test]
fn lower_layers_do_not_import_systems() {
    for layer in BELOW_SYSTEMS {
        let files = sources(&src().join(layer));
        assert!(!files.is_empty(), "{layer} has no sources");
        for (name, text) in files {
            assert!(!text.contains("systems::"), "{name} imports systems");
        }
    }
}

#[test]
fn systems_do_not_import_each_other() {
    let names: Vec<String> = fs::read_dir(src().join("systems"))
        .unwrap()
        .flatten()
        .filter(|entry| entry.path().is_dir())
        .map(|entry| entry.file_name().into_string().unwrap())
        .collect();
    assert!(names.contains(&"freetalk".to_owned()));
    for own in &names {
        for (file, text) in sources(&src().join("systems").join(own)) {
            assert_eq!(other_system(&text, own), None, "in {file}");
        }
    }
}

/// The first word after `systems::` in `text` that is not `own`.
fn other_system<'a>(text: &'a str, own: &str) -> Option<&'a str> {
    let words = text.split("systems::").skip(1).map(|rest| {
        let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_'));
        &rest[..end.unwrap_or(rest.len())]
    });
    words.into_iter().find(|word| *word != own)
}

#[test]
fn an_import_of_another_system_is_seen() {
    let text = "use crate::systems::freetalk::Ats;\nuse crate::systems::cafe_talk::Net;";
    assert_eq!(other_system(text, "freetalk"), Some("cafe_talk"));
    assert_eq!(
        other_system("use crate::systems::{freetalk, x};", "freetalk"),
        Some("")
    );
    assert_eq!(
        other_system("use crate::systems::freetalk::stm;", "freetalk"),
        None
    );
}

#[test]
fn library_never_prints() {
    for (name, text) in sources(&src()) {
        if name.contains("/cli/") || name.ends_with("/main.rs") {
            continue;
        }
        for word in ["println!", "eprintln!", "dbg!("] {
            assert!(!text.contains(word), "{name} prints: {word}");
        }
    }
}
