//! Libraries that run on older systems than the one that builds them.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};

use crate::{
    machine::{self, Platform},
    python::Venv,
    steps::Steps,
};

/// The oldest glibc of the systems that Blender 4.2 runs on (VFX platform 2023).
const GLIBC: Version = (2, 28);
const TARGET: &str = "x86_64-unknown-linux-gnu";

/// Major and minor number.
pub type Version = (u32, u32);

/// Builds both C libraries for release and returns their folder.
pub fn build(steps: &mut Steps) -> Result<PathBuf> {
    if Platform::here()? != Platform::LinuxX64 {
        let mut build = cargo();
        build.args(["build", "--release", "-p", "anyface-capi"]);
        build.env("CARGO_ENCODED_RUSTFLAGS", machine::release_flags());
        steps.run("build the native library", &mut build)?;
        let built = machine::target().join("release");
        machine::check_names_no_folder(&built.join(Platform::here()?.shared_library()))?;
        return Ok(built);
    }
    let python = Venv::Packaging.ensure(steps)?;
    let tools = python.parent().context("venv path")?;
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = [tools.to_owned()].into_iter();
    let path = std::env::join_paths(folders.chain(std::env::split_paths(&path)))?;
    let target = format!("{TARGET}.{}.{}", GLIBC.0, GLIBC.1);
    let mut build = cargo();
    // Zig links against the symbols of the glibc that is named.
    build.args([
        "zigbuild",
        "--release",
        "-p",
        "anyface-capi",
        "--target",
        &target,
    ]);
    steps.run(
        "build the native library for old systems",
        build
            .env("PATH", path)
            .env("CARGO_ENCODED_RUSTFLAGS", machine::release_flags()),
    )?;
    let built = machine::target().join(TARGET).join("release");
    check_glibc(&built.join("libanyface.so"))?;
    machine::check_names_no_folder(&built.join("libanyface.so"))?;
    Ok(built)
}

fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    command.current_dir(machine::root());
    command
}

/// Fails where `library` needs a newer glibc than promised.
fn check_glibc(library: &Path) -> Result<()> {
    let newest = needed_glibc(library)?;
    ensure!(
        newest <= GLIBC,
        "{}: expected symbols up to glibc {GLIBC:?}, got {newest:?}",
        library.display()
    );
    Ok(())
}

/// The oldest glibc that has all symbols which `library` needs.
pub fn needed_glibc(library: &Path) -> Result<Version> {
    let output = Command::new("objdump")
        .arg("-T")
        .arg(library)
        .output()
        .context("starting objdump")?;
    ensure!(
        output.status.success(),
        "objdump cannot read {}",
        library.display()
    );
    newest_glibc(&String::from_utf8_lossy(&output.stdout))
        .with_context(|| format!("{}: expected symbols of glibc, got none", library.display()))
}

/// The newest version of glibc that a symbol table names.
fn newest_glibc(table: &str) -> Option<Version> {
    let versions = table.split("GLIBC_").skip(1).filter_map(|rest| {
        let end = rest.find(|c: char| c != '.' && !c.is_ascii_digit());
        let mut numbers = rest[..end.unwrap_or(rest.len())].split('.');
        Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
    });
    versions.max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_as_numbers() {
        let table = "0 DF *UND* 0 (GLIBC_2.9) open\n0 DF *UND* 0 (GLIBC_2.28) fcntl64\n\
                     0 DF *UND* 0 (GLIBC_2.2.5) read\n";
        assert_eq!(newest_glibc(table), Some((2, 28)));
        assert_eq!(newest_glibc("no versions"), None);
    }
}
