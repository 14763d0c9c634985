//! The machine: its system and the folders of the repository.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};

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

/// A folder with nothing in it.
pub fn empty(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder)?;
    }
    fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))
}

/// Whether this process may install packages by itself.
pub fn is_root() -> bool {
    Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|out| out.stdout == b"0\n")
}
