//! `cargo xtask wheel`: the Python package with the native library, for any Python 3 on one system.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::{
    extension, machine,
    platform::Platform,
    portable,
    python::{self, PYTHON, Venv},
    steps::Steps,
    symbols,
};

/// The largest wheel: the weights of four systems take 23 MB, and the library may be a test build.
/// PyPI accepts up to 100 MB.
const LARGEST_MB: f64 = 40.0;

/// Builds the wheel `anyface-<version>-py3-none-<platform>.whl`.
#[derive(Args)]
pub struct Wheel {
    /// Take this library instead of building one.
    #[arg(long)]
    library: Option<PathBuf>,
    /// Optimised for shipping, on Linux for glibc 2.28; takes minutes.
    #[arg(long)]
    release: bool,
    /// Folder of the wheel; default `target/wheel`.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Wheel {
    /// Builds the wheel and prints its path.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("wheel")?;
        let library = match &self.library {
            Some(path) => path.clone(),
            None if self.release => {
                let platform = Platform::here()?;
                portable::build(&mut steps, platform, "release")?.join(platform.shared_library())
            }
            None => extension::build_library(&mut steps, false)?,
        };
        let out = self.out.clone().unwrap_or(machine::target().join("wheel"));
        println!("{}", build(&mut steps, &library, &out)?.display());
        Ok(())
    }
}

/// Packs `library` and the Python files into a wheel in the folder `out` and returns its path.
pub fn build(steps: &mut Steps, library: &Path, out: &Path) -> Result<PathBuf> {
    ensure!(library.is_file(), "no library at {}", library.display());
    let stage = machine::target().join("wheel-stage");
    machine::empty(&stage)?;
    let platform = Platform::of_library(library)?;
    let inside = extension::copy_libraries(steps, library, &stage)?;
    let mut pack = Command::new(PYTHON);
    pack.arg(machine::root().join("packaging/wheel/pack.py"));
    pack.arg("--library").args(&inside);
    pack.args(["--version", env!("CARGO_PKG_VERSION")]);
    pack.args(["--tag", &tag(platform, &inside)?]);
    pack.arg("--out").arg(out);
    let output = steps.run("pack the wheel", &mut pack)?;
    // The last line is the path. The log's heading comes before it.
    let path = PathBuf::from(output.lines().last().unwrap_or_default());
    let size_mb = fs::metadata(&path)
        .with_context(|| format!("expected a wheel, got {output:?}"))?
        .len() as f64
        / 1e6;
    ensure!(
        size_mb <= LARGEST_MB,
        "{}: expected {LARGEST_MB} MB at most, got {size_mb:.1}",
        path.display()
    );
    Ok(path)
}

/// The systems on which `libraries` run, as pip names them. On Linux, the tag names the oldest
/// glibc that has every symbol they need (PEP 600).
fn tag(platform: Platform, libraries: &[PathBuf]) -> Result<String> {
    let (system, processor) = platform.wheel_tag();
    Ok(match platform {
        Platform::LinuxX64 | Platform::LinuxArm64 => {
            let needed = libraries.iter().map(|path| symbols::needed_glibc(path));
            let needed = needed.collect::<Result<Vec<_>>>()?;
            let (major, minor) = needed.into_iter().max().context("expected a library")?;
            format!("{system}_{major}_{minor}_{processor}")
        }
        // The oldest versions of macOS that Rust builds for.
        Platform::MacosArm64 => format!("{system}_11_0_{processor}"),
        Platform::MacosX64 => format!("{system}_10_12_{processor}"),
        Platform::WindowsX64 => format!("{system}_{processor}"),
    })
}

/// Builds a wheel with `library`, runs the tests of tests/wheel on it and returns its path.
pub fn check(steps: &mut Steps, library: &Path) -> Result<PathBuf> {
    let wheel = build(steps, library, &machine::target().join("wheel"))?;
    let mut tests = python::pytest(&Venv::Blender.python(), "tests/wheel");
    steps.check("Python wheel", tests.env("ANYFACE_WHEEL", &wheel))?;
    Ok(wheel)
}
