//! A command that was built without sound devices: files and standard input alone.

use std::time::Duration;

use anyface::{Error, Result};
use clap::Args;

use crate::console::Console;

/// No flags.
#[derive(Args)]
pub struct DeviceArgs {}

/// There is none.
pub enum Microphone {}

/// There is none.
pub enum Monitor {}

/// What would have come of a microphone.
pub struct Block {
    pub samples: Vec<f32>,
    pub is_lost: bool,
}

impl DeviceArgs {
    pub fn are_to_be_listed(&self) -> bool {
        false
    }

    /// # Errors
    /// `InvalidInput`: there is no microphone.
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
