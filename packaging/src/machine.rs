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
    /// A linker for older systems.
    Packaging,
}

/// A system for which packages are made, as Blender names it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Platform {
    /// Linux on x86-64.
    LinuxX64,
    /// macOS on Apple's processors.
    MacosArm64,
    /// Windows on x86-64.
    WindowsX64,
}

impl Platform {
    /// That of this machine.
    pub fn here() -> Result<Self> {
        match (std::env::consts::OS, std::env::consts::ARCH) {
            ("linux", "x86_64") => Ok(Platform::LinuxX64),
            ("macos", "aarch64") => Ok(Platform::MacosArm64),
            ("windows", "x86_64") => Ok(Platform::WindowsX64),
            (system, processor) => bail!(
                "expected Linux or Windows on x86_64 or macOS on aarch64, got {system} on {processor}"
            ),
        }
    }

    /// The word in the extension's manifest and in file names.
    pub fn name(self) -> &'static str {
        match self {
            Platform::LinuxX64 => "linux-x64",
            Platform::MacosArm64 => "macos-arm64",
            Platform::WindowsX64 => "windows-x64",
        }
    }

    /// How cargo names the shared library.
    pub fn shared_library(self) -> &'static str {
        match self {
            Platform::LinuxX64 => "libanyface.so",
            Platform::MacosArm64 => "libanyface.dylib",
            Platform::WindowsX64 => "anyface.dll",
        }
    }

    /// How cargo names the static library.
    pub fn static_library(self) -> &'static str {
        match self {
            Platform::WindowsX64 => "anyface.lib",
            _ => "libanyface.a",
        }
    }
}

impl Venv {
    fn folder(self) -> &'static str {
        match self {
            Venv::Blender => "bpy",
            Venv::Training => "training",
            Venv::Packaging => "packaging",
        }
    }

    /// The file whose lines pip installs; its text decides whether the environment is current.
    fn requirements(self) -> PathBuf {
        match self {
            Venv::Blender => root().join("tests/addon/requirements.txt"),
            Venv::Training => root().join("training/requirements.txt"),
            Venv::Packaging => root().join("packaging/requirements.txt"),
        }
    }

    /// Its interpreter; `ANYFACE_VENVS` moves all environments to another folder.
    pub fn python(self) -> PathBuf {
        interpreter(self.folder())
    }

    /// Creates or refreshes the environment.
    pub fn ensure(self, steps: &mut Steps) -> Result<PathBuf> {
        let wanted = std::fs::read_to_string(self.requirements())
            .with_context(|| format!("reading {}", self.requirements().display()))?;
        environment(steps, PYTHON, self.folder(), &wanted)
    }
}

/// Python without an environment.
pub const PYTHON: &str = if cfg!(windows) { "python" } else { "python3" };

/// The interpreter of an environment; `ANYFACE_VENVS` moves all to another folder.
fn interpreter(name: &str) -> PathBuf {
    let base = std::env::var_os("ANYFACE_VENVS").map_or(target().join("venvs"), PathBuf::from);
    let inside = match cfg!(windows) {
        true => "Scripts/python.exe",
        false => "bin/python",
    };
    base.join(name).join(inside)
}

/// Creates or refreshes an environment of the interpreter `from`; `wanted` are pip's lines.
fn environment(steps: &mut Steps, from: &str, name: &str, wanted: &str) -> Result<PathBuf> {
    let python = interpreter(name);
    let folder = python.ancestors().nth(2).context("venv path")?.to_owned();
    let stamp = folder.join("installed.txt");
    if std::fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
        return Ok(python);
    }
    // Debian's python3 comes without it.
    let complete = Command::new(from).args(["-c", "import ensurepip"]).output();
    if !complete.is_ok_and(|out| out.status.success()) {
        ensure_apt(steps, &["python3-venv"])?;
    }
    let step = format!("install Python packages ({name})");
    steps.run(&step, Command::new(from).args(["-m", "venv"]).arg(&folder))?;
    let list = folder.join("wanted.txt");
    std::fs::write(&list, wanted)?;
    let mut pip = Command::new(&python);
    steps.run(&step, pip.args(["-m", "pip", "install", "-q", "-U", "pip"]))?;
    let mut pip = Command::new(&python);
    steps.run(
        &step,
        pip.args(["-m", "pip", "install", "-q", "-r"]).arg(list),
    )?;
    std::fs::write(&stamp, wanted)?;
    Ok(python)
}

/// A Python with Blender as a module: the usual one, or one of another `version` such as "4.2".
pub fn blender_python(steps: &mut Steps, version: Option<&str>) -> Result<PathBuf> {
    let Some(version) = version else {
        return Venv::Blender.ensure(steps);
    };
    let usual = std::fs::read_to_string(Venv::Blender.requirements())?;
    let name = format!("bpy-{version}");
    environment(
        steps,
        python_for(version)?,
        &name,
        &of_version(&usual, version),
    )
}

/// The Python that a version of Blender was built for.
fn python_for(version: &str) -> Result<&'static str> {
    let numbers = version
        .split_once('.')
        .and_then(|(major, minor)| Some((major.parse::<u32>().ok()?, minor.parse::<u32>().ok()?)));
    let Some(numbers) = numbers else {
        bail!("expected a version of Blender such as 4.2, got {version}");
    };
    Ok(match (cfg!(windows), numbers >= (5, 1)) {
        (true, _) => PYTHON,
        (false, true) => "python3.13",
        (false, false) => "python3.11",
    })
}

/// pip's lines with another version of bpy.
fn of_version(lines: &str, version: &str) -> String {
    let lines = lines.lines().map(|line| match line.starts_with("bpy==") {
        true => format!("bpy=={version}.*\n"),
        false => format!("{line}\n"),
    });
    lines.collect()
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
    if !cfg!(target_os = "linux") {
        return Ok(());
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_blender_changes_one_line_and_the_python() {
        let lines = of_version("bpy==5.0.1\npytest\n", "4.2");
        assert_eq!(lines, "bpy==4.2.*\npytest\n");
        assert!(python_for("5.0").unwrap() != python_for("5.2").unwrap() || cfg!(windows));
        assert!(python_for("five").unwrap_err().to_string().contains("five"));
    }
}
