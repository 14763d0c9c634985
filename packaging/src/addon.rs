//! `cargo xtask addon`: the installed extension in headless Blender, whichever version is wanted.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::Result;
use clap::Args;

use crate::{
    extension, machine,
    python::{self, Venv},
    steps::Steps,
    test,
};

/// Runs the tests of tests/addon on a zip.
#[derive(Args)]
pub struct Addon {
    /// Blender's version as `4.2`; default: the one of tests/addon/requirements.txt. Older and newer
    /// ones than 5.0 need the Python that they were built for: 3.11, and 3.13 from 5.1 on.
    #[arg(long)]
    blender: Option<String>,
    /// The zip to install; without it one is built.
    #[arg(long)]
    zip: Option<PathBuf>,
}

impl Addon {
    /// Installs what is missing, then runs the tests.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("addon")?;
        machine::ensure_apt(&mut steps, machine::BLENDER_LIBRARIES)?;
        let python = python::blender(&mut steps, self.blender.as_deref())?;
        let zip = match &self.zip {
            Some(zip) => zip.canonicalize()?,
            None => built_zip(&mut steps)?,
        };
        check(&mut steps, &python, &zip, None)?;
        steps.finish()
    }
}

/// A zip with an unoptimised library.
pub fn built_zip(steps: &mut Steps) -> Result<PathBuf> {
    let library = extension::build_library(steps, false)?;
    let zip = extension::default_zip();
    extension::build_zip(steps, &library, &zip)?;
    Ok(zip)
}

/// Runs the tests; `blender` is an executable to test as well.
pub fn check(steps: &mut Steps, python: &Path, zip: &Path, blender: Option<PathBuf>) -> Result<()> {
    let mut test = test::pytest(python, "tests/addon");
    test.env("ANYFACE_EXTENSION", zip);
    if let Some(blender) = blender {
        test.env("ANYFACE_BLENDER", blender);
    }
    steps.check("extension in headless Blender", &mut test)
}

/// Style of all Python files.
pub fn ruff(steps: &mut Steps) -> Result<()> {
    let mut ruff = Command::new(Venv::Blender.python());
    ruff.args([
        "-m",
        "ruff",
        "check",
        "blender-addon",
        "training",
        "tests",
        "packaging",
    ]);
    steps.check("ruff", ruff.current_dir(machine::root()))
}
