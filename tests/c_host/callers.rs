//! Checks that our programs call every function of the C interface. Nobody has tried one that none
//! of them needs.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use anyface_tests::native::root;

/// The functions of the header, in its order.
fn functions() -> Vec<String> {
    let header = without_comments(&read(&root().join("include/anyface.h")));
    let called = header.match_indices('(').map(|(at, _)| &header[..at]);
    let names = called.filter_map(|before| before.rsplit(|c| !is_of_name(c)).next());
    let names = names.filter(|name| name.starts_with("anyface_"));
    names.map(str::to_owned).collect()
}

fn is_of_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// C code without the comments after `//` and between `/*` and `*/`.
fn without_comments(text: &str) -> String {
    let mut code = String::new();
    for (number, part) in text.split("/*").enumerate() {
        let behind = match number {
            0 => part,
            _ => part.split_once("*/").map_or("", |(_, behind)| behind),
        };
        code.push_str(behind);
    }
    let lines = code.lines().map(|line| line.split("//").next());
    lines.flatten().collect::<Vec<_>>().join("\n")
}

/// The files with these endings in a folder and its subfolders.
fn files(folder: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).expect("the folder is there") {
        let path = entry.expect("the folder can be read").path();
        if path.is_dir() {
            paths.extend(files(&path, endings));
        } else if path
            .extension()
            .is_some_and(|of_path| endings.iter().any(|ending| of_path == *ending))
        {
            paths.push(path);
        }
    }
    paths
}

/// The functions that Python code names as attributes or strings. The table of signatures does not
/// count, since it calls nothing.
fn python_calls(text: &str) -> BTreeSet<String> {
    let table = text
        .split_once("\nSIGNATURES = {")
        .and_then(|(before, rest)| Some(format!("{before}{}", rest.split_once("\n}\n")?.1)));
    let code = table.unwrap_or(text.to_owned());
    let places = code.match_indices("anyface_");
    let called = places.filter(|(at, _)| code[..*at].ends_with(['.', '"']));
    let names = called.filter_map(|(at, _)| code[at..].split(|c| !is_of_name(c)).next());
    names.map(str::to_owned).collect()
}

#[test]
fn every_function_is_called_by_the_extension_the_wheel_or_an_example() {
    let mut names = BTreeSet::new();
    for folder in ["blender-addon", "packaging/wheel"] {
        for file in files(&root().join(folder), &["py"]) {
            names.extend(python_calls(&read(&file)));
        }
    }
    for file in files(&root().join("capi/examples"), &["c", "cpp"]) {
        let code = without_comments(&read(&file));
        names.extend(code.split(|c| !is_of_name(c)).map(str::to_owned));
    }
    let functions = functions();
    assert!(functions.len() > 100, "{functions:?}");
    // The extension builds the name of a `free` function from its noun. The function counts as
    // called if another function of the same noun is.
    let is_made = |noun: &str| names.iter().any(|name| name.starts_with(noun));
    let is_called =
        |name: &String| names.contains(name) || name.strip_suffix("free").is_some_and(is_made);
    let uncalled: Vec<_> = functions.iter().filter(|name| !is_called(name)).collect();
    assert!(
        uncalled.is_empty(),
        "{uncalled:?}: call them in an example, or take them away"
    );
}
