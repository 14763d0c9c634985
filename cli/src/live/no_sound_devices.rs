//! Stands in for sound devices in a command built without them, which reads only files and standard input.

use std::time::Duration;

use anyface::{Error, Result};
use clap::Args;

use crate::console::Console;

/// No options.
#[derive(Args)]
pub struct DeviceArgs {}

/// Never exists in this build.
pub enum Microphone {}

/// Never exists in this build.
pub enum Monitor {}

/// Samples as a microphone would return them.
pub struct Block {
    pub samples: Vec<f32>,
    pub is_lost: bool,
}

impl DeviceArgs {
    pub fn are_to_be_listed(&self) -> bool {
        false
    }

    /// # Errors
    /// Always `InvalidInput`, because there is no microphone.
    pub fn open(&self, _: &Console) -> Result<Microphone> {
        Err(Error::InvalidInput(
            "live: expected --input, since this command was built without microphones (the feature `microphone`)".into(),
        ))
    }

    pub fn monitor(&self, _: f64, _: &Console) -> Result<Option<Monitor>> {
        Ok(None)
    }
}

impl Microphone {
    pub fn name(&self) -> &str {
        match *self {}
    }

    pub fn read(&mut self, _: Duration) -> Block {
        match *self {}
    }
}

impl Monitor {
    pub fn push(&mut self, _: &[f32]) {
        match *self {}
    }

    pub fn is_playing(&self) -> bool {
        match *self {}
    }
}

pub fn print_devices(_: &Console) -> Result<()> {
    Ok(())
}
