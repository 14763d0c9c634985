//! `cargo xtask demo`.

use anyhow::Result;
use clap::Args;

use crate::steps::Steps;

/// Animates the default head and Suzanne with a sentence.
#[derive(Args)]
pub struct Demo {}

impl Demo {
    /// Runs it.
    pub fn run(&self) -> Result<()> {
        Steps::new("demo")?.finish()
    }
}
