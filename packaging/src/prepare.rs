//! `cargo xtask prepare`: installs what the tests need, so that it can be fetched while cargo
//! compiles.

use std::process::Command;

use anyhow::Result;
use clap::Args;

use crate::{
    apt, chroot,
    python::{self, Venv},
    steps::{Started, Steps},
};

/// Installs the Python environments of the tests, and Blender and Godot as programs.
#[derive(Args)]
pub struct Prepare {
    /// Also install this version of Blender, such as 4.2, to test the extension in.
    #[arg(long)]
    blender: Option<String>,
}

impl Prepare {
    /// Installs everything.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("prepare")?;
        apt::ensure(&mut steps, apt::BLENDER_LIBRARIES)?;
        Venv::Blender.ensure(&mut steps)?;
        python::blender(&mut steps, self.blender.as_deref())?;
        chroot::BLENDER.executable(&mut steps)?;
        chroot::GODOT.executable(&mut steps)?;
        Venv::Farm.ensure(&mut steps)?;
        Venv::Training.ensure(&mut steps)?;
        steps.finish()
    }
}

/// Starts `cargo xtask prepare` alongside the steps that follow. None of these may call apt-get,
/// because only one apt-get can run at a time.
pub fn start(steps: &mut Steps, blender: Option<&str>) -> Result<Started> {
    let mut prepare = Command::new(std::env::current_exe()?);
    prepare.arg("prepare");
    if let Some(version) = blender {
        prepare.args(["--blender", version]);
    }
    steps.start("Python environments, Blender and Godot", &mut prepare)
}
