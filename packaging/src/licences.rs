//! The licences that go into every package, and `cargo xtask licences`, which writes those of the
//! linked crates.

use std::{fs, path::Path, process::Command};

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::{Value, json};

use crate::{machine, steps::Steps, third_party};

/// Files of the repository that go into every package: our licences, the works we used, and the
/// linked crates.
pub const FILES: &[&str] = &["LICENSE-MIT", "LICENSE-APACHE", "NOTICE", THIRD_PARTY];

/// The crates linked into the command and the library, with their licences.
const THIRD_PARTY: &str = "THIRD-PARTY.md";

/// The crates whose packages link others: the command, which enables every feature of the library,
/// and the microphone, which it loads.
const LINKING: [&str; 2] = ["cli", "microphone"];

/// The version of cargo-about that THIRD-PARTY.md is written with.
const CARGO_ABOUT: &str = "0.9.3";

/// Copies the licences into `folder`.
///
/// # Errors
/// If a file is missing or the folder cannot be written.
pub fn copy(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    for name in FILES {
        fs::copy(machine::root().join(name), folder.join(name))
            .with_context(|| format!("copying {name}"))?;
    }
    Ok(())
}

/// Writes THIRD-PARTY.md from Cargo.lock, with cargo-about and packaging/about.toml.
#[derive(Args)]
pub struct Licences {}

impl Licences {
    /// Fetches the crates for all systems, then collects their licences without the network.
    pub fn run(&self) -> Result<()> {
        let version = Command::new("cargo-about").arg("--version").output();
        let version = version.map_or(String::new(), |output| {
            String::from_utf8_lossy(&output.stdout).trim().to_owned()
        });
        ensure!(
            version.ends_with(CARGO_ABOUT),
            "expected cargo-about {CARGO_ABOUT} on the PATH, got {:?}; \
             run cargo install --locked --features cli cargo-about@{CARGO_ABOUT}",
            if version.is_empty() { "none" } else { &version }
        );
        let mut steps = Steps::new("licences")?;
        let mut fetch = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
        fetch.args(["fetch", "--locked"]);
        steps.run("fetch the crates", fetch.current_dir(machine::root()))?;
        let (mut crates, mut licences) = (Vec::new(), Vec::new());
        for folder in LINKING {
            let mut report = collect(&mut steps, folder)?;
            for (name, all) in [("crates", &mut crates), ("licenses", &mut licences)] {
                let list = report[name].as_array_mut();
                all.append(list.with_context(|| format!("cargo-about wrote no list {name:?}"))?);
            }
        }
        let template = fs::read_to_string(machine::root().join("packaging/third-party.md.in"))?;
        let all = json!({"crates": crates, "licenses": licences});
        let page = third_party::page(&template, &all)?;
        let file = machine::root().join(THIRD_PARTY);
        fs::write(&file, page)?;
        println!("wrote {}", file.display());
        Ok(())
    }
}

/// The JSON of cargo-about for the crate in `folder`.
fn collect(steps: &mut Steps, folder: &str) -> Result<Value> {
    let report = machine::target().join("licences.json");
    let mut about = Command::new("cargo-about");
    about
        .current_dir(machine::root())
        .args(["generate", "--frozen", "--fail", "--manifest-path"])
        .arg(format!("{folder}/Cargo.toml"))
        .args(["--config", "packaging/about.toml"])
        .args(["--format", "json", "--output-file"])
        .arg(&report);
    steps.run(&format!("collect the licences of {folder}"), &mut about)?;
    Ok(serde_json::from_slice(&fs::read(report)?)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_receives_our_licences_and_those_of_linked_crates() {
        let folder = std::env::temp_dir().join(format!("anyface-licences-{}", std::process::id()));
        copy(&folder.join("share/doc")).unwrap();
        let text = |name| fs::read_to_string(folder.join("share/doc").join(name)).unwrap();
        assert!(text("NOTICE").contains(THIRD_PARTY));
        assert!(text(THIRD_PARTY).contains("symphonia-core"));
        assert!(text("LICENSE-MIT").contains("Permission is hereby granted"));
        assert!(text("LICENSE-APACHE").contains("Apache License"));
        fs::remove_dir_all(folder).unwrap();
    }
}
