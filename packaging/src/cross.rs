//! Compilers for other systems: rustup's where it has the target, else Debian's with the standard library as sources.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};

use crate::{apt, machine, steps::Steps};

/// Debian's compiler, whose name is that of its first users.
const DEBIAN: &[&str] = &["rustc-web", "cargo-web", "rust-web-src", "lld"];
/// What `rust-web-src` puts where that compiler looks.
const DEBIAN_SOURCES: &str = "/usr/lib/rustlib/src";

/// A system that is not this one.
pub struct Target {
    /// How Rust names it.
    pub triple: &'static str,
    /// The parts of the standard library that are built where the compiler has none for it.
    pub standard_library: &'static str,
    /// What links for it with Debian's compiler.
    pub linker: &'static str,
    /// Debian packages that it takes with either compiler.
    pub packages: &'static [&'static str],
}

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
        let by_rustup = self.is_known()?;
        let cargo = match by_rustup {
            true => std::env::var_os("CARGO").unwrap_or("cargo".into()),
            false => "/usr/bin/cargo".into(),
        };
        let mut build = Command::new(cargo);
        build
            .current_dir(machine::root())
            .args([task, "--target", self.triple, "--target-dir"])
            .arg(self.folder())
            .env(
                "CARGO_ENCODED_RUSTFLAGS",
                [&machine::release_flags(), flags].join(if flags.is_empty() { "" } else { "\x1f" }),
            );
        if !by_rustup {
            ensure!(
                Path::new(DEBIAN_SOURCES).is_dir(),
                "expected Rust for {0}, found none: rustup target add {0}",
                self.triple
            );
            let variable = self.triple.to_uppercase().replace('-', "_");
            build
                .env(format!("CARGO_TARGET_{variable}_LINKER"), self.linker)
                .arg(format!("-Zbuild-std={}", self.standard_library))
                .env("RUSTC", "/usr/bin/rustc")
                .env("RUSTC_BOOTSTRAP", "1")
                .env_remove("RUSTUP_TOOLCHAIN");
        }
        Ok(build)
    }

    /// Where a profile leaves what was built.
    pub fn built(&self, profile: &str) -> PathBuf {
        self.folder().join(self.triple).join(profile)
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
