//! The machine: its system, the folders of the repository, Debian packages installed where missing.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Result, bail, ensure};

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

/// Says so where the disk has less room than a first run takes, which otherwise ends in the middle.
pub fn note_room(gigabytes: u64) {
    let free = fs4::available_space(root()).unwrap_or(u64::MAX) / 1_000_000_000;
    if free < gigabytes {
        println!("note     {free} GB of disk are free; a first run takes {gigabytes}");
    }
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
    let mut install = vec!["install", "-y", "-q", "--no-install-recommends"];
    install.extend(&missing);
    let name = format!("install {}", missing.join(" "));
    for (name, arguments) in [
        ("read Debian's list of packages", vec!["update", "-q"]),
        (&name, install),
    ] {
        let words: Vec<&str> = prefix.iter().copied().chain(["apt-get"]).collect();
        let mut command = Command::new(words[0]);
        command.args(&words[1..]).args(arguments);
        steps.run(name, command.env("DEBIAN_FRONTEND", "noninteractive"))?;
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
