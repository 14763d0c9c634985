//! Checks that THIRD-PARTY.md lists every crate that is linked into our releases, under a licence
//! that we accept.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// A crate's name and version.
type Release = (String, String);

/// The rows of the table in THIRD-PARTY.md, with their licence expressions.
fn listed() -> BTreeMap<Release, String> {
    let text = read("THIRD-PARTY.md");
    let rows = text.lines().filter_map(|line| line.strip_prefix("| "));
    let cells = rows.map(|row| row.split(" | ").collect::<Vec<_>>());
    let crates = cells.filter(|cells| cells.len() > 2 && cells[0] != "crate" && cells[0] != "---");
    crates
        .map(|cells| ((cells[0].into(), cells[1].into()), cells[2].into()))
        .collect()
}

/// The third-party crates that the command, the C library and the microphone link on this system, with their
/// licences.
fn linked() -> BTreeMap<Release, String> {
    let mut tree = Command::new(env!("CARGO"));
    tree.current_dir(root()).args([
        "tree",
        "--locked",
        "--offline",
        "--edges=normal",
        "--package=anyface-cli",
        "--package=anyface-capi",
        "--package=anyface-microphone",
        "--prefix=none",
        "--no-dedupe",
        "--format={p}|{l}",
    ]);
    let output = tree.output().expect("cargo starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = String::from_utf8(output.stdout).expect("cargo prints text");
    let lines = text.lines().filter_map(|line| line.split_once('|'));
    let releases = lines.filter_map(|(package, licence)| {
        let (name, rest) = package.split_once(" v")?;
        // After our own crates, `cargo tree` prints their folder.
        let of_others = !rest.contains(['/', '\\']);
        let version = rest.split(' ').next()?;
        of_others.then(|| ((name.into(), version.into()), licence.into()))
    });
    releases.collect()
}

/// The licences that packaging/about.toml accepts.
fn accepted() -> Vec<String> {
    let text = read("packaging/about.toml");
    let list = text
        .split_once("accepted = [")
        .and_then(|(_, rest)| rest.split_once(']'))
        .expect("packaging/about.toml has a list of accepted licences")
        .0;
    list.split('"')
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .collect()
}

/// Whether the accepted licences suffice for an expression such as `(MIT OR Apache-2.0) AND
/// Unicode-3.0`. Older crates write a slash in place of OR.
fn is_acceptable(expression: &str, accepted: &[String]) -> bool {
    let spaced = expression
        .replace('/', " OR ")
        .replace('(', " ( ")
        .replace(')', " ) ");
    // A licence with an exception counts as a different licence.
    let joined = spaced.replace(" WITH ", "+");
    let mut words = joined.split_whitespace().peekable();
    any_of(&mut words, accepted) && words.next().is_none()
}

type Words<'a> = std::iter::Peekable<std::str::SplitWhitespace<'a>>;

fn any_of(words: &mut Words, accepted: &[String]) -> bool {
    let mut holds = all_of(words, accepted);
    while words.next_if_eq(&"OR").is_some() {
        holds |= all_of(words, accepted);
    }
    holds
}

fn all_of(words: &mut Words, accepted: &[String]) -> bool {
    let mut holds = one_of(words, accepted);
    while words.next_if_eq(&"AND").is_some() {
        holds &= one_of(words, accepted);
    }
    holds
}

fn one_of(words: &mut Words, accepted: &[String]) -> bool {
    match words.next() {
        Some("(") => {
            let holds = any_of(words, accepted);
            words.next() == Some(")") && holds
        }
        Some(licence) => accepted.iter().any(|known| known == licence),
        None => false,
    }
}

#[test]
fn every_linked_crate_is_listed_with_its_version() {
    let (listed, linked) = (listed(), linked());
    assert!(linked.len() > 100, "cargo tree names {}", linked.len());
    for release in linked.keys() {
        let (name, version) = release;
        assert!(
            listed.contains_key(release),
            "THIRD-PARTY.md lacks {name} {version}: run cargo xtask licences"
        );
    }
}

/// This also covers crates for other systems, whose releases `cargo tree` cannot list here.
#[test]
fn every_listed_crate_is_that_of_the_lock_file() {
    let lock = read("Cargo.lock").replace("\r\n", "\n");
    for (name, version) in listed().keys() {
        assert!(
            lock.contains(&format!("name = \"{name}\"\nversion = \"{version}\"\n")),
            "THIRD-PARTY.md lists {name} {version}, which is not in Cargo.lock: run cargo xtask licences"
        );
    }
}

#[test]
fn every_licence_is_accepted() {
    let accepted = accepted();
    for ((name, version), licence) in listed().into_iter().chain(linked()) {
        assert!(
            is_acceptable(&licence, &accepted),
            "{name} {version} is under {licence:?}; packaging/about.toml accepts {accepted:?}"
        );
    }
}

/// If the licence files of a new release differ, the list shows the licence of its manifest. This
/// test then fails, and somebody has to read the files.
#[test]
fn what_a_manifest_leaves_out_is_listed() {
    let (config, listed) = (read("packaging/about.toml"), listed());
    let mut clarified = 0;
    for (name, rest) in config
        .split("\n[")
        .filter_map(|part| part.split_once(".clarify]\n"))
    {
        let expected = rest.split('"').nth(1).expect("a licence");
        let row = listed
            .iter()
            .find(|((listed_name, _), _)| listed_name == name);
        let got = row.map(|(_, licence)| licence.as_str());
        assert_eq!(
            got,
            Some(expected),
            "{name} in THIRD-PARTY.md and packaging/about.toml"
        );
        clarified += 1;
    }
    assert!(clarified > 0);
}

/// MPL-2.0 demands that everyone who receives the program learns where the source is.
#[test]
fn the_source_of_crates_under_the_mozilla_licence_is_named() {
    let text = read("THIRD-PARTY.md");
    let mozilla = listed().into_iter().filter(|row| row.1.contains("MPL-2.0"));
    let releases: Vec<Release> = mozilla.map(|row| row.0).collect();
    assert!(!releases.is_empty());
    for (name, version) in releases {
        let address = format!("https://crates.io/crates/{name}/{version}");
        assert!(text.contains(&address), "{address}");
    }
}

#[test]
fn an_expression_is_acceptable_where_accepted_licences_suffice() {
    let accepted = ["MIT".to_owned(), "Zlib".to_owned()];
    for (expression, expected) in [
        ("MIT", true),
        ("GPL-3.0-only", false),
        ("GPL-3.0-only OR MIT", true),
        ("Apache-2.0/MIT", true),
        ("MIT AND GPL-3.0-only", false),
        ("MIT AND Zlib", true),
        ("(GPL-3.0-only OR MIT) AND Zlib", true),
        ("(GPL-3.0-only OR MIT) AND Unicode-3.0", false),
        ("GPL-3.0-only OR MIT AND Apache-2.0", false),
        ("MIT WITH LLVM-exception", false),
        ("MIT Zlib", false),
        ("", false),
    ] {
        assert_eq!(
            is_acceptable(expression, &accepted),
            expected,
            "{expression}"
        );
    }
}
