//! Checks what crates.io requires of each crate and what it shows of it.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

use serde_json::Value;

/// The largest packed crate that crates.io accepts, in bytes.
const CRATES_IO_BYTES: u64 = 10_485_760;
/// The most keywords that crates.io accepts for a crate.
const KEYWORDS: usize = 5;
/// The crates that are published. All others say `publish = false`.
const PUBLISHED: [&str; 9] = [
    "anyface",
    "anyface-cli",
    "anyface-microphone",
    "anyface-weights-cafe-talk",
    "anyface-weights-ear",
    "anyface-weights-emoface",
    "anyface-weights-facetalk",
    "anyface-weights-freetalk",
    "anyface-weights-shared",
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn cargo(words: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO"));
    let output = command.args(words).current_dir(root()).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo {words:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// The crates of the workspace by name, as cargo describes them.
fn packages() -> BTreeMap<String, Value> {
    let text = cargo(&["metadata", "--no-deps", "--offline", "--format-version=1"]);
    let metadata: Value = serde_json::from_str(&text).unwrap();
    let packages = metadata["packages"].as_array().unwrap().iter();
    let named = packages.map(|package| (package["name"].as_str().unwrap().into(), package.clone()));
    named.collect()
}

/// Packs every published crate once, as `cargo publish` does. Returns the folder of the archives.
fn packed() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let target = root().join("target/crates");
        let named = PUBLISHED.iter().flat_map(|name| ["-p", name]);
        let words = ["package", "--no-verify", "--allow-dirty", "--offline"];
        let words: Vec<&str> = words.into_iter().chain(named).collect();
        let folder = ["--target-dir", target.to_str().unwrap()];
        cargo(&[words, folder.to_vec()].concat());
        target.join("package")
    })
}

/// The archive of a crate.
fn archive(name: &str) -> PathBuf {
    packed().join(format!("{name}-{}.crate", env!("CARGO_PKG_VERSION")))
}

#[test]
fn every_crate_is_published_or_says_that_it_is_not() {
    let packages = packages();
    let published = packages
        .iter()
        .filter(|(_, package)| package["publish"].is_null());
    let names: Vec<&str> = published.map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, PUBLISHED);
}

#[test]
fn every_packed_crate_is_small_enough() {
    for name in PUBLISHED {
        let got = fs::metadata(archive(name)).unwrap().len();
        println!("{name} {got}");
        assert!(
            got < CRATES_IO_BYTES,
            "{name}: expected less than {CRATES_IO_BYTES} bytes, got {got}"
        );
    }
}

#[test]
fn every_packed_crate_has_its_licences_and_a_page() {
    for name in PUBLISHED {
        let list = Command::new("tar").arg("-tzf").arg(archive(name)).output();
        let list = String::from_utf8(list.unwrap().stdout).unwrap();
        for file in ["LICENSE-MIT", "LICENSE-APACHE", "NOTICE", "README.md"] {
            let path = format!("{name}-{}/{file}", env!("CARGO_PKG_VERSION"));
            assert!(list.lines().any(|line| line == path), "{name} lacks {file}");
        }
    }
}

#[test]
fn every_published_crate_describes_itself() {
    let packages = packages();
    let has = |package: &Value, field: &str| match &package[field] {
        Value::Array(items) => !items.is_empty(),
        value => value.as_str().is_some_and(|text| !text.is_empty()),
    };
    // All crates have the same repository address, or none has one.
    let addresses: Vec<&Value> = PUBLISHED
        .iter()
        .map(|name| &packages[*name]["repository"])
        .collect();
    assert!(
        addresses.windows(2).all(|pair| pair[0] == pair[1]),
        "{addresses:?}"
    );
    for name in PUBLISHED {
        let package = &packages[name];
        let fields = [
            "description",
            "license",
            "readme",
            "keywords",
            "categories",
            "authors",
        ];
        for field in fields {
            assert!(has(package, field), "{name} lacks {field}");
        }
        let keywords = package["keywords"].as_array().unwrap();
        assert!(keywords.len() <= KEYWORDS, "{name}: {keywords:?}");
    }
}

/// A build from crates.io fetches its dependencies there too, so each must be published and have a
/// version.
#[test]
fn published_crates_need_published_ones_of_a_version() {
    let packages = packages();
    for name in PUBLISHED {
        for needed in packages[name]["dependencies"].as_array().unwrap() {
            let (path, kind) = (needed["path"].as_str(), needed["kind"].as_str());
            if path.is_none() || kind == Some("dev") {
                continue;
            }
            let other = needed["name"].as_str().unwrap();
            assert!(
                PUBLISHED.contains(&other),
                "{name} needs {other}, which is not published"
            );
            assert_ne!(needed["req"], "*", "{name} needs {other} of any version");
        }
    }
}

/// Building a host compiles the weights without running any code of theirs.
#[test]
fn no_crate_of_weights_has_a_build_script() {
    let weights = root().join("weights");
    for folder in fs::read_dir(weights).unwrap().flatten() {
        let manifest = fs::read_to_string(folder.path().join("Cargo.toml")).unwrap();
        assert!(!folder.path().join("build.rs").exists());
        assert!(!manifest.contains("build"), "{:?}", folder.file_name());
    }
}
