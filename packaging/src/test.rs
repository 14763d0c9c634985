//! `cargo xtask test`: lints, Rust tests, C hosts, the installed extension, the Python wheel, training.

use std::{path::PathBuf, process::Command};

use anyhow::Result;
use clap::Args;

use crate::{
    addon, extension, machine,
    python::{self, Venv},
    steps::Steps,
    wheel,
};

/// Debian packages that the tests call: C hosts, a memory checker, voices, film.
const TOOLS: &[&str] = &[
    "gcc",
    "g++",
    "cmake",
    "make",
    "pkg-config",
    "valgrind",
    "espeak-ng",
    "flite",
    "ffmpeg",
];

/// Gigabytes that a first run takes: builds 8, PyTorch with its CUDA libraries 6 and 3 while it is
/// installed, Blender 3.
const ROOM: u64 = 20;

/// Runs all tests; about half an hour from a clean checkout on two cores, 8 minutes when built.
#[derive(Args)]
pub struct Test {
    /// Leave out the parts that install PyTorch and Blender.
    #[arg(long)]
    rust_only: bool,
    /// Test the extension in this version of Blender, such as 4.2, instead of the usual one.
    #[arg(long)]
    blender: Option<String>,
}

impl Test {
    /// Runs every check, prints the counts, fails if one failed.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("test")?;
        machine::note_room(ROOM);
        machine::ensure_apt(&mut steps, TOOLS)?;
        lints(&mut steps)?;
        rust(&mut steps)?;
        if self.rust_only {
            steps.ignore("extension in headless Blender", "--rust-only");
            steps.ignore("Python wheel", "--rust-only");
            steps.ignore("training", "--rust-only");
        } else {
            machine::ensure_apt(&mut steps, machine::BLENDER_LIBRARIES)?;
            python_parts(&mut steps, self.blender.as_deref())?;
            training(&mut steps)?;
        }
        steps.finish()
    }
}

fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    command.current_dir(machine::root());
    command
}

fn lints(steps: &mut Steps) -> Result<()> {
    steps.check("rustfmt", cargo().args(["fmt", "--all", "--check"]))?;
    steps.check(
        "clippy",
        cargo().args([
            "clippy",
            "--workspace",
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ]),
    )
}

fn rust(steps: &mut Steps) -> Result<()> {
    let mut test = cargo();
    test.args(["test", "--workspace", "--no-fail-fast", "--"]);
    match machine::shared() {
        Some(folder) => {
            test.arg("--include-ignored").env("ANYFACE_SHARED", folder);
        }
        None => println!("note     no ../shared here: the tests that need it are ignored"),
    }
    steps.check("Rust tests and C hosts", &mut test)
}

fn python_parts(steps: &mut Steps, version: Option<&str>) -> Result<()> {
    if !machine::root().join("tests/addon").is_dir() {
        return Ok(());
    }
    Venv::Blender.ensure(steps)?;
    addon::ruff(steps)?;
    let python = python::blender(steps, version)?;
    let zip = addon::built_zip(steps, false)?;
    let executable = blender(steps)?;
    addon::check(steps, &python, &zip, executable)?;
    wheel::check(steps, &extension::library_of("dev")?)
}

/// A Blender executable that knows extensions: the caller's, or Debian 13's in a folder of its own.
pub fn blender(steps: &mut Steps) -> Result<Option<PathBuf>> {
    if let Some(path) = std::env::var_os("ANYFACE_BLENDER") {
        return Ok(Some(path.into()));
    }
    if !machine::is_root() {
        println!("note     not root: no Blender executable is installed for its test");
        return Ok(None);
    }
    machine::ensure_apt(steps, &["debootstrap"])?;
    let folder = machine::target().join("blender-chroot");
    let script = machine::root().join("packaging/blender-chroot.sh");
    steps.run(
        "install a Blender executable",
        Command::new(script).arg(&folder),
    )?;
    let executable = folder.canonicalize()?.join("run-blender");
    // It mounts /tmp in its folder, which some containers forbid.
    let tried = Command::new(&executable).arg("--version").output()?;
    if !tried.status.success() {
        let why = String::from_utf8_lossy(&tried.stderr).trim().to_owned();
        steps.ignore("tests with a Blender executable", &why);
        return Ok(None);
    }
    Ok(Some(executable))
}

fn training(steps: &mut Steps) -> Result<()> {
    if !machine::root().join("training/tests").is_dir() {
        return Ok(());
    }
    let python = Venv::Training.ensure(steps)?;
    steps.check("training", &mut pytest(&python, "training/tests"))
}

/// pytest on one folder, with the data for it.
pub fn pytest(python: &std::path::Path, folder: &str) -> Command {
    let mut command = Command::new(python);
    command.args(["-m", "pytest", "-q", "-p", "no:cacheprovider", folder]);
    command.current_dir(machine::root());
    if let Some(shared) = machine::shared() {
        command.env("ANYFACE_SHARED", shared);
    }
    command
}
