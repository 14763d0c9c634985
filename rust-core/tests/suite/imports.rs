//! Checks that no source of the library breaks its rules. `tests/imports.rs` checks the order of
//! the folders.

use std::{fs, path::Path};

fn sources(folder: &Path) -> Vec<(String, String)> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push((
                path.display().to_string(),
                fs::read_to_string(&path).unwrap(),
            ));
        }
    }
    files
}

fn src() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
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
    for system in &names {
        for (file, text) in sources(&src().join("systems").join(system)) {
            assert_eq!(other_system(&text, system), None, "in {file}");
        }
    }
}

/// The first system other than `system` that `text` names after `systems::`. Names of modules are
/// in small letters. Names of items that systems share, such as the trait, are not.
fn other_system<'a>(text: &'a str, system: &str) -> Option<&'a str> {
    let imports = text.split("systems::").skip(1).flat_map(|rest| {
        let (names, end) = match rest.strip_prefix('{') {
            Some(inside) => (inside, inside.find('}')),
            None => (
                rest,
                rest.find(|c: char| !(c.is_alphanumeric() || c == '_')),
            ),
        };
        names[..end.unwrap_or(names.len())].split(',')
    });
    imports
        .map(|name| name.trim().split("::").next().unwrap_or_default())
        .find(|name| name.starts_with(|c: char| c.is_lowercase()) && *name != system)
}

#[test]
fn an_import_of_another_system_is_seen() {
    for (text, other) in [
        (
            "use crate::systems::freetalk::Ats;\nuse crate::systems::cafe_talk::Net;",
            Some("cafe_talk"),
        ),
        (
            "use crate::systems::{Registration, System, emoface::Mesh};",
            Some("emoface"),
        ),
        ("use crate::systems::{Registration, System};", None),
        ("use crate::systems::freetalk::stm;", None),
    ] {
        assert_eq!(other_system(text, "freetalk"), other, "{text}");
    }
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

/// Only one place reads files, because it enforces limits and can stop waiting.
#[test]
fn files_are_read_in_one_place() {
    let others = [
        "job/input.rs",
        // Reads small files of the operating system.
        "job/memory.rs",
        // Reads its own receipts, and hashes files that it is about to replace.
        "job/receipts.rs",
        // Compares the sound beside a scene with the sound.
        "cli/src/scene.rs",
        // Reads the history of a batch line by line, and appends to it.
        "batch/ledger.rs",
        // Only tests read files here.
        "nn/golden.rs",
        "operators/fixtures.rs",
    ];
    let ways = [
        "fs::read(",
        "fs::read_to_string(",
        "File::open(",
        ".read(true)",
    ];
    for folder in [
        src(),
        src().join("../../cli/src"),
        src().join("../../capi/src"),
    ] {
        for (name, text) in sources(&folder) {
            if others.iter().any(|other| name.ends_with(other)) || name.ends_with("tests.rs") {
                continue;
            }
            let code = text
                .split("#[cfg(test)]\nmod tests")
                .next()
                .unwrap_or_default();
            let way = ways.iter().find(|way| code.contains(**way));
            assert_eq!(way, None, "{name}: expected job::read_file or job::Input");
        }
    }
}
