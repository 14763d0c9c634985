//! `cargo xtask test`: lints, Rust tests, C hosts, the installed extension, the Python wheel,
//! training.

use std::process::Command;

use anyhow::Result;
use clap::Args;

use crate::{
    addon, apt, chroot, docs, elsewhere, extension, machine,
    platform::Platform,
    prepare,
    python::{self, Venv},
    steps::Steps,
    web, wheel,
};

/// Debian packages that the tests use: C compilers and build tools, a memory checker, speech
/// synthesisers, a video encoder, a sound system, C#, the scheduler of a render farm and the
/// network tools for its hosts.
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
    "pulseaudio",
    "pulseaudio-utils",
    "mono-mcs",
    "mono-runtime",
    "slurm-wlm",
    "munge",
    "iproute2",
];

/// Debian packages that the page's tests use, each with the names that its program has on various
/// systems. A package is not installed if the machine already has one of these programs.
const PAGE_TOOLS: [(&str, &[&str]); 3] = [
    ("nodejs", &["node"]),
    ("npm", &["npm"]),
    (
        "chromium",
        &["chromium", "chromium-browser", "google-chrome"],
    ),
];

/// Gigabytes of disk that a first run takes: builds 8, PyTorch with its CUDA libraries 6 and
/// another 3 during its installation, Blender 3, Godot 1.
const ROOM: u64 = 21;

/// Runs all tests; about an hour from a clean checkout on two cores, half of that when built.
#[derive(Args)]
pub struct Test {
    /// Leave out the parts that install PyTorch and Blender.
    #[arg(long)]
    rust_only: bool,
    /// Test the extension in this version of Blender, such as 4.2, instead of the usual one.
    #[arg(long)]
    blender: Option<String>,
    /// Instead, test what another system gets. Name the system as Rust does: x86_64-pc-windows-gnu
    /// runs under Wine, aarch64-unknown-linux-gnu under QEMU.
    #[arg(long, value_parser = Platform::of_words)]
    target: Option<Platform>,
}

impl Test {
    /// Runs every check, prints the counts and fails if a check failed.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("test")?;
        if let Some(platform) = self.target {
            elsewhere::check(&mut steps, platform)?;
            return steps.finish();
        }
        machine::note_room(ROOM);
        let page = PAGE_TOOLS
            .iter()
            .filter(|(_, programs)| !programs.iter().any(|program| machine::has(program)));
        let page: Vec<&str> = page.map(|(package, _)| *package).collect();
        apt::ensure(
            &mut steps,
            &[TOOLS, apt::SOUND, &page, &web::packages()?].concat(),
        )?;
        documents(&mut steps)?;
        if self.rust_only {
            rust(&mut steps)?;
            steps.ignore("extension in headless Blender", "--rust-only");
            steps.ignore("Python wheel", "--rust-only");
            steps.ignore("training", "--rust-only");
        } else {
            let prepared = prepare::start(&mut steps, self.blender.as_deref())?;
            rust(&mut steps)?;
            steps.join(prepared)?;
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

fn documents(steps: &mut Steps) -> Result<()> {
    let name = "what makes the documents";
    if let Some(why) = docs::missing() {
        steps.ignore(name, why);
        return Ok(());
    }
    let mut check = Command::new(std::env::current_exe()?);
    steps.check(name, check.args(["docs", "--check"]))
}

fn rust(steps: &mut Steps) -> Result<()> {
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
    )?;
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
    addon::types(steps)?;
    let python = python::blender(steps, version)?;
    let zip = addon::built_zip(steps, false)?;
    let executable = chroot::BLENDER.executable(steps)?;
    addon::check(steps, &python, &zip, executable.as_deref())?;
    let library = extension::library_of("dev")?;
    let wheel = wheel::check(steps, &library)?;
    let command = library.with_file_name("anyface");
    let mut receivers = python::pytest(&Venv::Blender.python(), "tests/receivers");
    if let Some(godot) = chroot::GODOT.executable(steps)? {
        receivers.env("ANYFACE_GODOT", godot);
    }
    steps.check("receivers", receivers.env("ANYFACE_COMMAND", &command))?;
    if let (Some(program), None) = (web::missing(), std::env::var_os("CI")) {
        steps.ignore(
            "library for browsers, and its page",
            &format!("no {program}"),
        );
    } else {
        web::build(steps)?;
        let mut page = python::pytest(&Venv::Blender.python(), "tests/web");
        steps.check(
            "library for browsers, and its page",
            page.env("ANYFACE_COMMAND", &command),
        )?;
    }
    let engines = Venv::Farm.ensure(steps)?;
    let mut farm = python::pytest(&engines, "tests/farm");
    farm.env("ANYFACE_COMMAND", command);
    steps.check("engines of farms", farm.env("ANYFACE_EXTENSION", &zip))?;
    let mut site = python::pytest(&Venv::Blender.python(), "tests/site");
    if let Some(blender) = executable {
        site.env("ANYFACE_BLENDER", blender);
    }
    site.env("ANYFACE_EXTENSION", zip)
        .env("ANYFACE_WHEEL", wheel);
    steps.check("site, workflows, and what stores ask", &mut site)
}

fn training(steps: &mut Steps) -> Result<()> {
    if !machine::root().join("training/tests").is_dir() {
        return Ok(());
    }
    let python = Venv::Training.ensure(steps)?;
    steps.check("training", &mut python::pytest(&python, "training/tests"))
}
