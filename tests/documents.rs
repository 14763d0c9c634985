//! Checks that the source paths in documents and comments exist, and the names of code in
//! documents.

use std::{
    collections::HashSet,
    fs,
    path::{Path, PathBuf},
};

const ENDINGS: [&str; 5] = ["rs", "py", "md", "h", "c"];
/// Folders that hold no sources of this project.
const SKIPPED: [&str; 3] = ["target", "runs", "demo-output"];

/// Adds every source and document under `folder` to `paths`.
fn files(folder: &Path, paths: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        let name = entry.file_name().into_string().unwrap();
        let ending = path.extension().unwrap_or_default();
        if path.is_dir() && !name.starts_with('.') && !SKIPPED.contains(&name.as_str()) {
            files(&path, paths);
        } else if ENDINGS.iter().any(|known| ending == *known) {
            paths.push(path);
        }
    }
}

/// The path and text of every source and document.
fn texts() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut paths = Vec::new();
    files(&root, &mut paths);
    let shown = |path: &Path| path.strip_prefix(&root).unwrap().display().to_string();
    let read = |path: &PathBuf| (shown(path), fs::read_to_string(path).unwrap());
    paths.iter().map(read).collect()
}

/// The text between single backticks on one line, outside fenced blocks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    let prose = text.split("```").step_by(2);
    let lines = prose.flat_map(str::lines);
    lines.flat_map(|line| line.split('`').skip(1).step_by(2))
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

#[test]
fn sources_that_are_named_exist() {
    let texts = texts();
    let files: Vec<&Path> = texts.iter().map(|(file, _)| Path::new(file)).collect();
    for (file, text) in &texts {
        for name in quoted(text).filter(|name| name.contains('/')) {
            let plain = name.chars().all(|c| is_word(c) || "./-".contains(c));
            if plain && [".rs", ".py"].iter().any(|ending| name.ends_with(ending)) {
                let there = files.iter().any(|path| path.ends_with(name));
                assert!(there, "{file} names {name}, which is nowhere");
            }
        }
    }
}

#[test]
fn names_of_the_code_in_documents_exist() {
    let texts = texts();
    let sources = texts.iter().filter(|(file, _)| !file.ends_with(".md"));
    let words = sources.flat_map(|(_, text)| text.split(|c| !is_word(c)));
    let words: HashSet<&str> = words.collect();
    for (file, text) in texts.iter().filter(|(file, _)| file.ends_with(".md")) {
        for name in quoted(text).filter(|name| name.contains("::")) {
            let mut parts = name.split("::").map(|part| part.split('(').next().unwrap());
            let known = |part: &str| words.contains(part);
            assert!(parts.all(known), "{file} names {name}, which is nowhere");
        }
    }
}
