//! `cargo xtask windows`: what Windows gets, built on Linux and tried under Wine.

use std::{fs, path::PathBuf};

use anyhow::Result;
use clap::Args;

use crate::{
    chroot,
    cross::Target,
    extension,
    machine::{self, Platform},
    python::{self, Venv},
    steps::Steps,
};

/// 64-bit Windows, by GNU's linker.
const WINDOWS: Target = Target {
    triple: "x86_64-pc-windows-gnu",
    standard_library: "std,panic_unwind",
    linker: "x86_64-w64-mingw32-gcc",
    packages: &["gcc-mingw-w64-x86-64-win32"],
};

/// Builds anyface.exe, anyface.dll and the extension for Windows, and tries them under Wine where this is root.
#[derive(Args)]
pub struct Windows {
    /// Profile of Cargo.toml: `demo` compiles sooner than `release`, with the same results.
    #[arg(long, default_value = "demo")]
    profile: String,
    /// Build without trying.
    #[arg(long)]
    no_test: bool,
}

impl Windows {
    /// Runs it.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("windows")?;
        let built = self.build(&mut steps)?;
        let zip = built.join(extension::zip_name(Platform::WindowsX64));
        let library = built.join(Platform::WindowsX64.shared_library());
        extension::build_zip(&mut steps, &library, &zip)?;
        for path in [built.join("anyface.exe"), library, zip] {
            let size = fs::metadata(&path)?.len() as f64 / 1e6;
            println!("{size:6.1} MB {}", path.display());
        }
        if self.no_test {
            return steps.finish();
        }
        let Some(wine) = chroot::WINE.executable(&mut steps)? else {
            return steps.finish();
        };
        Venv::Blender.ensure(&mut steps)?;
        // What it is compared with.
        steps.run(
            "build for this machine",
            &mut extension::library_build("dev"),
        )?;
        let mut test = python::pytest(&Venv::Blender.python(), "tests/windows");
        test.env("ANYFACE_WINE", wine)
            .env("ANYFACE_WINDOWS", &built);
        test.env("ANYFACE_COMMAND", machine::target().join("debug/anyface"));
        steps.check("Windows programs under Wine", &mut test)?;
        steps.finish()
    }

    /// The folder with the command and both libraries.
    fn build(&self, steps: &mut Steps) -> Result<PathBuf> {
        let mut build = WINDOWS.cargo(steps, "build", "")?;
        build.args(["--profile", &self.profile]);
        build.args([
            "-p",
            "anyface-cli",
            "-p",
            "anyface-capi",
            "-p",
            "anyface-microphone",
        ]);
        steps.run("build for Windows", &mut build)?;
        Ok(WINDOWS.built(&self.profile))
    }
}
