//! The systems for which packages are made.

use std::{fs, path::Path};

use anyhow::{Context, Result, bail};
use object::{Architecture, BinaryFormat, Object};

use crate::cross::{self, Target};

/// A system and a processor.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Platform {
    /// Linux on x86-64.
    LinuxX64,
    /// Linux on 64-bit ARM.
    LinuxArm64,
    /// macOS on Apple's processors.
    MacosArm64,
    /// macOS on Intel's processors.
    MacosX64,
    /// Windows on x86-64.
    WindowsX64,
}

impl Platform {
    /// All platforms.
    pub const ALL: [Platform; 5] = [
        Platform::LinuxX64,
        Platform::LinuxArm64,
        Platform::MacosArm64,
        Platform::MacosX64,
        Platform::WindowsX64,
    ];

    /// The platform of this machine.
    pub fn here() -> Result<Self> {
        let here = (std::env::consts::OS, std::env::consts::ARCH);
        let (system, processor) = here;
        let platform = Self::ALL
            .into_iter()
            .find(|platform| platform.key() == here);
        platform.with_context(|| format!("expected {}, got {system} on {processor}", Self::names()))
    }

    /// The platform of a target as Rust names it, such as `aarch64-apple-darwin`.
    ///
    /// # Errors
    /// If no platform has that target. The message lists all known targets.
    pub fn of_triple(triple: &str) -> Result<Self> {
        let mut all = Self::ALL.into_iter();
        all.find(|platform| platform.target().triple == triple)
            .with_context(|| {
                let known = Self::ALL
                    .map(|platform| platform.target().triple)
                    .join(", ");
                format!("expected one of {known}, got {triple:?}")
            })
    }

    /// Does the same as `of_triple`, for arguments of a command line.
    ///
    /// # Errors
    /// The message of the error.
    pub fn of_words(triple: &str) -> Result<Self, String> {
        Self::of_triple(triple).map_err(|error| error.to_string())
    }

    /// The platform of a shared library, found from the contents of the file.
    ///
    /// # Errors
    /// If the file cannot be read, or is for another system.
    pub fn of_library(library: &Path) -> Result<Self> {
        let bytes = fs::read(library).with_context(|| format!("reading {}", library.display()))?;
        let file = object::File::parse(&bytes[..])
            .with_context(|| format!("{}: expected a shared library", library.display()))?;
        let platform = match (file.format(), file.architecture()) {
            (BinaryFormat::Elf, Architecture::X86_64) => Platform::LinuxX64,
            (BinaryFormat::Elf, Architecture::Aarch64) => Platform::LinuxArm64,
            (BinaryFormat::MachO, Architecture::Aarch64) => Platform::MacosArm64,
            (BinaryFormat::MachO, Architecture::X86_64) => Platform::MacosX64,
            (BinaryFormat::Pe, Architecture::X86_64) => Platform::WindowsX64,
            (format, processor) => bail!(
                "{}: expected a library for {}, got {format:?} for {processor:?}",
                library.display(),
                Self::names()
            ),
        };
        Ok(platform)
    }

    /// Blender's name for it, which the extension's manifest and file names use.
    pub fn name(self) -> &'static str {
        match self {
            Platform::LinuxX64 => "linux-x64",
            Platform::LinuxArm64 => "linux-arm64",
            Platform::MacosArm64 => "macos-arm64",
            Platform::MacosX64 => "macos-x64",
            Platform::WindowsX64 => "windows-x64",
        }
    }

    /// How the platform tag of its wheels begins and ends: `manylinux` and `x86_64` for
    /// `manylinux_2_28_x86_64`.
    pub fn wheel_tag(self) -> (&'static str, &'static str) {
        match self {
            Platform::LinuxX64 => ("manylinux", "x86_64"),
            Platform::LinuxArm64 => ("manylinux", "aarch64"),
            Platform::MacosArm64 => ("macosx", "arm64"),
            Platform::MacosX64 => ("macosx", "x86_64"),
            Platform::WindowsX64 => ("win", "amd64"),
        }
    }

    /// How Rust compiles for it.
    pub fn target(self) -> &'static Target {
        match self {
            Platform::LinuxX64 => &cross::LINUX_X64,
            Platform::LinuxArm64 => &cross::LINUX_ARM64,
            Platform::MacosArm64 => &cross::MACOS_ARM64,
            Platform::MacosX64 => &cross::MACOS_X64,
            Platform::WindowsX64 => &cross::WINDOWS_X64,
        }
    }

    /// Whether it is Linux.
    pub fn is_linux(self) -> bool {
        matches!(self, Platform::LinuxX64 | Platform::LinuxArm64)
    }

    /// How cargo names the shared library.
    pub fn shared_library(self) -> &'static str {
        match self {
            Platform::LinuxX64 | Platform::LinuxArm64 => "libanyface.so",
            Platform::MacosArm64 | Platform::MacosX64 => "libanyface.dylib",
            Platform::WindowsX64 => "anyface.dll",
        }
    }

    /// How cargo names the microphone library.
    pub fn microphone_library(self) -> &'static str {
        match self {
            Platform::LinuxX64 | Platform::LinuxArm64 => "libanyface_microphone.so",
            Platform::MacosArm64 | Platform::MacosX64 => "libanyface_microphone.dylib",
            Platform::WindowsX64 => "anyface_microphone.dll",
        }
    }

    /// How cargo names the static library; for Windows it depends on the linker.
    pub fn static_library(self) -> &'static str {
        match self {
            Platform::WindowsX64 if cfg!(windows) => "anyface.lib",
            _ => "libanyface.a",
        }
    }

    /// How cargo names the command.
    pub fn command(self) -> &'static str {
        match self {
            Platform::WindowsX64 => "anyface.exe",
            _ => "anyface",
        }
    }

    /// System and processor as Rust's standard library names them.
    fn key(self) -> (&'static str, &'static str) {
        match self {
            Platform::LinuxX64 => ("linux", "x86_64"),
            Platform::LinuxArm64 => ("linux", "aarch64"),
            Platform::MacosArm64 => ("macos", "aarch64"),
            Platform::MacosX64 => ("macos", "x86_64"),
            Platform::WindowsX64 => ("windows", "x86_64"),
        }
    }

    fn names() -> String {
        Self::ALL.map(Platform::name).join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_is_found_by_its_triple_and_others_are_named() {
        for platform in Platform::ALL {
            let triple = platform.target().triple;
            assert_eq!(Platform::of_triple(triple).unwrap(), platform);
        }
        let message = Platform::of_triple("z80-none").unwrap_err().to_string();
        assert!(message.contains("aarch64-apple-darwin"), "{message}");
        assert!(message.contains("z80-none"), "{message}");
    }

    #[test]
    fn a_library_says_for_which_system_it_is() {
        let program = std::env::current_exe().unwrap();
        assert_eq!(
            Platform::of_library(&program).unwrap(),
            Platform::here().unwrap()
        );
        let text = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        let message = format!("{:#}", Platform::of_library(&text).unwrap_err());
        assert!(message.contains("expected a shared library"), "{message}");
    }
}
