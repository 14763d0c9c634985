//! Compiles for other systems: with rustup's compiler if it has the target, else with Debian's
//! compiler and the sources of the standard library.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};

use crate::{apt, machine, python::Venv, steps::Steps};

/// Debian's packages of the compiler, named after its first users, the web browsers.
const DEBIAN: &[&str] = &["rustc-web", "cargo-web", "rust-web-src", "lld"];
/// Where `rust-web-src` puts its sources, and where that compiler looks for them.
const DEBIAN_SOURCES: &str = "/usr/lib/rustlib/src";
/// The oldest glibc of the systems that Blender 4.2 runs on (VFX platform 2023).
pub const GLIBC: (u32, u32) = (2, 28);

/// A system to compile for.
pub struct Target {
    /// Rust's name for it.
    pub triple: &'static str,
    /// The parts of the standard library to build if the compiler has none for this system.
    pub standard_library: &'static str,
    /// The linker for it on this machine. `None` if only Zig can link for it.
    pub linker: Option<&'static str>,
    /// The Debian packages of that linker and of the emulator, if any, for its programs.
    pub packages: &'static [&'static str],
}

const UNWIND: &str = "std,panic_unwind";

/// Linux on x86-64.
pub const LINUX_X64: Target = Target {
    triple: "x86_64-unknown-linux-gnu",
    standard_library: UNWIND,
    linker: Some("cc"),
    packages: &[],
};

/// Linux on 64-bit ARM.
pub const LINUX_ARM64: Target = Target {
    triple: "aarch64-unknown-linux-gnu",
    standard_library: UNWIND,
    linker: Some("aarch64-linux-gnu-gcc"),
    // Debian only recommends the C library's headers beside the compiler.
    packages: &[
        "gcc-aarch64-linux-gnu",
        "libc6-dev-arm64-cross",
        "qemu-user",
    ],
};

/// macOS on Apple's processors.
pub const MACOS_ARM64: Target = Target {
    triple: "aarch64-apple-darwin",
    standard_library: UNWIND,
    linker: None,
    packages: &[],
};

/// macOS on Intel's processors.
pub const MACOS_X64: Target = Target {
    triple: "x86_64-apple-darwin",
    standard_library: UNWIND,
    linker: None,
    packages: &[],
};

/// 64-bit Windows: for Microsoft's linker when built on Windows, else for MinGW's.
pub const WINDOWS_X64: Target = Target {
    triple: if cfg!(windows) {
        "x86_64-pc-windows-msvc"
    } else {
        "x86_64-pc-windows-gnu"
    },
    standard_library: UNWIND,
    linker: Some("x86_64-w64-mingw32-gcc"),
    packages: &["gcc-mingw-w64-x86-64-win32"],
};

impl Target {
    /// The Debian packages that this machine needs to compile for this system.
    pub fn all_packages(&self) -> Result<Vec<&'static str>> {
        let compiler = if self.is_known()? { &[][..] } else { DEBIAN };
        Ok([compiler, self.packages].concat())
    }

    /// Cargo's command `task` for this system. It has a folder of its own, because a change of
    /// flags would rebuild everything.
    pub fn cargo(&self, steps: &mut Steps, task: &str, flags: &str) -> Result<Command> {
        apt::ensure(steps, &self.all_packages()?)?;
        let mut build = self.command(task, self.triple, flags)?;
        if let (Some(linker), true) = (self.linker, self.needs_linker()?) {
            build.env(self.variable("LINKER"), linker);
        }
        Ok(build)
    }

    /// Cargo's command that builds for versions of this system that are years old. Zig links
    /// against the symbols that they have.
    pub fn cargo_for_old_systems(&self, steps: &mut Steps) -> Result<Command> {
        apt::ensure(steps, &self.all_packages()?)?;
        let python = Venv::Packaging.ensure(steps)?;
        let tools = python.parent().context("venv path")?.to_owned();
        let path = std::env::var_os("PATH").unwrap_or_default();
        let paths = [tools].into_iter().chain(std::env::split_paths(&path));
        // Rust strips macOS libraries with a tool of its own, which comes with rustup's compiler
        // but not with Debian's.
        let path = std::env::join_paths(paths.chain([tools_of_rust()?]))?;
        let target = if self.triple.ends_with("linux-gnu") {
            format!("{}.{}.{}", self.triple, GLIBC.0, GLIBC.1)
        } else {
            self.triple.to_owned()
        };
        let mut build = self.command("zigbuild", &target, "")?;
        build.env("PATH", path);
        Ok(build)
    }

    /// The environment variable that sets Cargo's `what`, such as `RUNNER`, for this target alone.
    pub fn variable(&self, what: &str) -> String {
        let target = self.triple.to_uppercase().replace('-', "_");
        format!("CARGO_TARGET_{target}_{what}")
    }

    /// The folder where Cargo leaves the files of a profile.
    pub fn built(&self, profile: &str) -> PathBuf {
        let folder = if profile == "dev" { "debug" } else { profile };
        self.folder().join(self.triple).join(folder)
    }

    /// Cargo, with a compiler that has the standard library for this system or its sources.
    fn compiler(&self) -> Result<Command> {
        if self.is_known()? {
            return Ok(Command::new(
                std::env::var_os("CARGO").unwrap_or("cargo".into()),
            ));
        }
        ensure!(
            Path::new(DEBIAN_SOURCES).is_dir(),
            "expected Rust for {0}, found none: rustup target add {0}",
            self.triple
        );
        let mut cargo = Command::new("/usr/bin/cargo");
        cargo
            .env("CARGO", "/usr/bin/cargo")
            .env("RUSTC", "/usr/bin/rustc")
            .env("RUSTC_BOOTSTRAP", "1")
            .env_remove("RUSTUP_TOOLCHAIN");
        Ok(cargo)
    }

    /// Cargo's command `task`. `triple` may also name a version of glibc.
    fn command(&self, task: &str, triple: &str, flags: &str) -> Result<Command> {
        let separator = if flags.is_empty() { "" } else { "\x1f" };
        let mut build = self.compiler()?;
        build
            .current_dir(machine::root())
            .args([task, "--target", triple, "--target-dir"])
            .arg(self.folder())
            .env(
                "CARGO_ENCODED_RUSTFLAGS",
                [&machine::release_flags(), flags].join(separator),
            );
        if !self.is_known()? {
            build.arg(format!("-Zbuild-std={}", self.standard_library));
        }
        Ok(build)
    }

    /// Whether Cargo must be told the linker. rustup comes with one only for browsers.
    fn needs_linker(&self) -> Result<bool> {
        Ok(cfg!(target_os = "linux") && (!self.packages.is_empty() || !self.is_known()?))
    }

    fn folder(&self) -> PathBuf {
        machine::target().join(format!("for-{}", self.triple))
    }

    /// Whether the current compiler has a standard library for this system.
    fn is_known(&self) -> Result<bool> {
        let rustc = std::env::var_os("RUSTC").unwrap_or("rustc".into());
        let folder = Command::new(rustc)
            .args(["--print", "target-libdir", "--target", self.triple])
            .output()
            .context("asking rustc for its targets")?;
        let folder = String::from_utf8_lossy(&folder.stdout);
        Ok(Path::new(folder.trim()).is_dir())
    }
}

/// The folder of the tools that come with rustup's compiler.
fn tools_of_rust() -> Result<PathBuf> {
    let rustc = std::env::var_os("RUSTC").unwrap_or("rustc".into());
    let folder = Command::new(rustc)
        .args(["--print", "target-libdir"])
        .output()
        .context("asking rustc for its folder")?;
    let folder = String::from_utf8_lossy(&folder.stdout);
    Ok(Path::new(folder.trim()).with_file_name("bin"))
}
