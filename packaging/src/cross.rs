//! Compilers for other systems: rustup's where it has the target, else Debian's with the standard library as sources.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};

use crate::{apt, machine, python::Venv, steps::Steps};

/// Debian's compiler, whose name is that of its first users.
const DEBIAN: &[&str] = &["rustc-web", "cargo-web", "rust-web-src", "lld"];
/// What `rust-web-src` puts where that compiler looks.
const DEBIAN_SOURCES: &str = "/usr/lib/rustlib/src";
/// The oldest glibc of the systems that Blender 4.2 runs on (VFX platform 2023).
pub const GLIBC: (u32, u32) = (2, 28);

/// A system for which this one compiles.
pub struct Target {
    /// How Rust names it.
    pub triple: &'static str,
    /// The parts of the standard library that are built where the compiler has none for it.
    pub standard_library: &'static str,
    /// What links for it here; none where only Zig does.
    pub linker: Option<&'static str>,
    /// Debian packages with that linker, and what runs its programs.
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
    packages: &["gcc-aarch64-linux-gnu", "qemu-user"],
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

/// 64-bit Windows, by the linker of the system that builds.
pub const WINDOWS_X64: Target = Target {
    triple: match cfg!(windows) {
        true => "x86_64-pc-windows-msvc",
        false => "x86_64-pc-windows-gnu",
    },
    standard_library: UNWIND,
    linker: Some("x86_64-w64-mingw32-gcc"),
    packages: &["gcc-mingw-w64-x86-64-win32"],
};

impl Target {
    /// Debian packages that are needed here.
    pub fn all_packages(&self) -> Result<Vec<&'static str>> {
        let compiler = match self.is_known()? {
            true => &[][..],
            false => DEBIAN,
        };
        Ok([compiler, self.packages].concat())
    }

    /// Cargo's command `task` for this system, in a folder of its own: flags of others would build everything anew.
    pub fn cargo(&self, steps: &mut Steps, task: &str, flags: &str) -> Result<Command> {
        apt::ensure(steps, &self.all_packages()?)?;
        let mut build = self.command(task, self.triple, flags)?;
        if let (Some(linker), true) = (self.linker, self.needs_linker()?) {
            build.env(self.variable("LINKER"), linker);
        }
        Ok(build)
    }

    /// Cargo's command that builds for systems of this kind that are years older: Zig links it with their symbols.
    pub fn cargo_for_old_systems(&self, steps: &mut Steps) -> Result<Command> {
        apt::ensure(steps, &self.all_packages()?)?;
        let python = Venv::Packaging.ensure(steps)?;
        let tools = python.parent().context("venv path")?.to_owned();
        let path = std::env::var_os("PATH").unwrap_or_default();
        let paths = [tools].into_iter().chain(std::env::split_paths(&path));
        // Rust strips libraries of macOS with a tool of its own, which Debian's lacks and rustup's brings.
        let path = std::env::join_paths(paths.chain([tools_of_rust()?]))?;
        let target = match self.triple.ends_with("linux-gnu") {
            true => format!("{}.{}.{}", self.triple, GLIBC.0, GLIBC.1),
            false => self.triple.to_owned(),
        };
        let mut build = self.command("zigbuild", &target, "")?;
        build.env("PATH", path);
        Ok(build)
    }

    /// The variable by which cargo is told `what`, such as `RUNNER`, of this target alone.
    pub fn variable(&self, what: &str) -> String {
        let target = self.triple.to_uppercase().replace('-', "_");
        format!("CARGO_TARGET_{target}_{what}")
    }

    /// Where a profile leaves what was built.
    pub fn built(&self, profile: &str) -> PathBuf {
        let folder = if profile == "dev" { "debug" } else { profile };
        self.folder().join(self.triple).join(folder)
    }

    /// Cargo with a compiler that knows this system, or its sources.
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

    /// Cargo's command `task`; `triple` may name a version of glibc too.
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

    /// rustup brings a linker for browsers alone.
    fn needs_linker(&self) -> Result<bool> {
        Ok(cfg!(target_os = "linux") && (!self.packages.is_empty() || !self.is_known()?))
    }

    fn folder(&self) -> PathBuf {
        machine::target().join(format!("for-{}", self.triple))
    }

    /// Whether the compiler that runs this has a standard library for it.
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

/// The folder of the tools that rustup's compiler brings.
fn tools_of_rust() -> Result<PathBuf> {
    let rustc = std::env::var_os("RUSTC").unwrap_or("rustc".into());
    let folder = Command::new(rustc)
        .args(["--print", "target-libdir"])
        .output()
        .context("asking rustc for its folder")?;
    let folder = String::from_utf8_lossy(&folder.stdout);
    Ok(Path::new(folder.trim()).with_file_name("bin"))
}
