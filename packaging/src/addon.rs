//! `cargo xtask addon`: tests the installed extension in headless Blender, in any version.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result};
use clap::Args;

use crate::{
    apt, chroot, extension, machine,
    python::{self, Venv},
    steps::Steps,
};

/// Runs the tests of tests/addon on a zip.
#[derive(Args)]
pub struct Addon {
    /// Blender's version, such as `4.2`; default: the one in tests/addon/requirements.txt. Each
    /// version needs the Python that it was built for: 3.11 up to 5.0, 3.13 from 5.1 on.
    #[arg(long)]
    blender: Option<String>,
    /// The zip to install; without it one is built.
    #[arg(long)]
    zip: Option<PathBuf>,
    /// Measure the extension's speed instead, with the optimised library, for
    /// docs/measured/speed.md.
    #[arg(long)]
    bench: bool,
    /// Photograph Blender's window instead, for docs/images/blender.
    #[arg(long, conflicts_with = "bench")]
    photographs: bool,
}

impl Addon {
    /// Installs what is missing, then runs the tests.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("addon")?;
        apt::ensure(&mut steps, apt::BLENDER_LIBRARIES)?;
        let python = python::blender(&mut steps, self.blender.as_deref())?;
        let zip = match &self.zip {
            Some(zip) => zip.canonicalize()?,
            None => built_zip(&mut steps, self.bench)?,
        };
        if self.bench {
            return bench(&mut steps, &python, &zip);
        }
        if self.photographs {
            photograph(&mut steps, &python, &zip)?;
        } else {
            check(&mut steps, &python, &zip, None)?;
        }
        steps.finish()
    }
}

/// Builds the library and a zip with it.
pub fn built_zip(steps: &mut Steps, release: bool) -> Result<PathBuf> {
    let library = extension::build_library(steps, release)?;
    let zip = extension::default_zip();
    extension::build_zip(steps, &library, &zip)?;
    Ok(zip)
}

/// Measures, and prints rows for the tables of docs/measured/speed.md.
fn bench(steps: &mut Steps, python: &Path, zip: &Path) -> Result<()> {
    apt::ensure(steps, &["flite"])?;
    let mut measure = Command::new(python);
    measure.arg(machine::root().join("tests/addon/bench_blender.py"));
    measure.env("ANYFACE_EXTENSION", zip);
    if let Some(blender) = chroot::BLENDER.executable(steps)? {
        measure.env("ANYFACE_BLENDER", blender);
    }
    let output = steps.run("measure in Blender", &mut measure)?;
    for line in output.lines().filter(|line| line.starts_with('|')) {
        println!("{line}");
    }
    Ok(())
}

/// Runs the tests that drive and photograph Blender's window. Copies the pictures for the pages
/// into docs/images/blender.
fn photograph(steps: &mut Steps, python: &Path, zip: &Path) -> Result<()> {
    let blender = chroot::BLENDER.executable(steps)?;
    let blender = blender.context("expected a Blender with a display, which needs Debian")?;
    let folder = machine::target().join("photographs");
    machine::empty(&folder)?;
    let mut test = python::pytest(python, "tests/addon");
    // One window at a time: beside others, it would not be drawn yet when its picture is taken.
    test.args(["-k", "test_window", "-n", "0"])
        .env("ANYFACE_EXTENSION", zip)
        .env("ANYFACE_BLENDER", blender)
        .env("ANYFACE_PHOTOGRAPHS", folder.canonicalize()?);
    steps.run("photograph Blender's window", &mut test)?;
    for picture in fs::read_dir(folder.join("pages"))? {
        let picture = picture?;
        let page = machine::root().join("docs/images/blender");
        fs::copy(picture.path(), page.join(picture.file_name()))?;
    }
    Ok(())
}

/// Runs the tests. `blender` is a Blender executable to test as well.
pub fn check(steps: &mut Steps, python: &Path, zip: &Path, blender: Option<&Path>) -> Result<()> {
    let mut test = python::pytest(python, "tests/addon");
    test.env("ANYFACE_EXTENSION", zip);
    if let Some(blender) = blender {
        test.env("ANYFACE_BLENDER", blender);
    }
    steps.check("extension in headless Blender", &mut test)
}

/// Checks the style of all Python files.
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

/// Checks the types of the wheel and of all of `blender-addon/core`, which are one package only
/// once they are copied together.
pub fn types(steps: &mut Steps) -> Result<()> {
    let root = machine::root();
    let folder = machine::target().join("types");
    machine::empty(&folder)?;
    let package = folder.join("anyface");
    extension::copy_folder(&root.join("packaging/wheel/anyface"), &package)?;
    extension::copy_folder(&root.join("blender-addon/core"), &package.join("core"))?;
    let mut mypy = Command::new(Venv::Blender.python());
    mypy.args(["-m", "mypy", "--package", "anyface", "--cache-dir"])
        .arg(machine::target().join("mypy"))
        .env("MYPYPATH", folder);
    steps.check("mypy", mypy.current_dir(root))
}
