//! What the tasks need on the machine, installed where it is missing: Debian packages through
//! apt, Python packages into virtual environments under `target/`.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail, ensure};

use crate::steps::Steps;

/// Libraries that Blender's Python wheel links against.
pub const BLENDER_LIBRARIES: &[&str] = &[
    "libx11-6",
    "libxrender1",
    "libxfixes3",
    "libxi6",
    "libxext6",
    "libxkbcommon0",
    "libsm6",
    "libice6",
    "libgl1",
];

/// A Python environment of the project.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Venv {
    /// Blender as a module, pytest and ruff.
    Blender,
    /// PyTorch and what training needs.
    Training,
}

impl Venv {
    fn folder(self) -> &'static str {
        match self {
            Venv::Blender => "bpy",
            Venv::Training => "training",
        }
    }

    /// The file whose lines pip installs; its text decides whether the environment is current.
    fn requirements(self) -> PathBuf {
        match self {
            Venv::Blender => root().join("tests/addon/requirements.txt"),
            Venv::Training => root().join("training/requirements.txt"),
        }
    }

    /// Its interpreter; `ANYFACE_VENVS` moves all environments to another folder.
    pub fn python(self) -> PathBuf {
        let base = std::env::var_os("ANYFACE_VENVS").map_or(target().join("venvs"), PathBuf::from);
        base.join(self.folder()).join("bin/python")
    }

    /// Creates or refreshes the environment.
    pub fn ensure(self, steps: &mut Steps) -> Result<PathBuf> {
        let python = self.python();
        let folder = python.ancestors().nth(2).context("venv path")?.to_owned();
        let wanted = std::fs::read_to_string(self.requirements())
            .with_context(|| format!("reading {}", self.requirements().display()))?;
        let stamp = folder.join("installed.txt");
        if std::fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
            return Ok(python);
        }
        // Debian's python3 comes without it.
        let complete = Command::new("python3")
            .args(["-c", "import ensurepip"])
            .output();
        if !complete.is_ok_and(|out| out.status.success()) {
            ensure_apt(steps, &["python3-venv"])?;
        }
        let name = format!("install Python packages ({})", self.folder());
        steps.run(
            &name,
            Command::new("python3").arg("-m").arg("venv").arg(&folder),
        )?;
        steps.run(
            &name,
            Command::new(&python).args(["-m", "pip", "install", "-q", "-U", "pip"]),
        )?;
        steps.run(
            &name,
            Command::new(&python)
                .args(["-m", "pip", "install", "-q", "-r"])
                .arg(self.requirements()),
        )?;
        std::fs::write(&stamp, wanted)?;
        Ok(python)
    }
}

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map(Path::to_owned)
        .unwrap_or_default()
}

/// Cargo's build folder.
pub fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or(root().join("target"), PathBuf::from)
}

/// Third-party data for the tests that need it; not part of a clone.
pub fn shared() -> Option<PathBuf> {
    let folder = std::env::var_os("ANYFACE_SHARED").map_or(root().join("../shared"), PathBuf::from);
    folder.join("data").is_dir().then_some(folder)
}

/// Whether a program is on the PATH.
pub fn has(program: &str) -> bool {
    std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())
        .any(|folder| folder.join(program).is_file())
}

/// Installs Debian packages that are missing.
pub fn ensure_apt(steps: &mut Steps, packages: &[&str]) -> Result<()> {
    let missing: Vec<&str> = packages.iter().copied().filter(|p| !installed(p)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    ensure!(
        has("apt-get"),
        "needs the packages {}, and there is no apt-get to install them",
        missing.join(" ")
    );
    let mut prefix: Vec<&str> = Vec::new();
    if !is_root() {
        if !has("sudo") {
            bail!("needs root once: apt-get install {}", missing.join(" "));
        }
        prefix.push("sudo");
    }
    for words in [vec!["apt-get", "update", "-qq"], {
        let mut words = vec!["apt-get", "install", "-y", "-qq", "--no-install-recommends"];
        words.extend(&missing);
        words
    }] {
        let words: Vec<&str> = prefix.iter().copied().chain(words).collect();
        steps.run(
            &format!("install {}", missing.join(" ")),
            Command::new(words[0])
                .args(&words[1..])
                .env("DEBIAN_FRONTEND", "noninteractive"),
        )?;
    }
    Ok(())
}

fn installed(package: &str) -> bool {
    Command::new("dpkg-query")
        .args(["-W", "-f=${Status}", package])
        .output()
        .is_ok_and(|out| String::from_utf8_lossy(&out.stdout).contains("install ok installed"))
}

/// Whether this process may install packages by itself.
pub fn is_root() -> bool {
    Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|out| out.stdout == b"0\n")
}
