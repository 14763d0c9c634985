//! `anyface info`: what this build is and what it carries.

use clap::Args;

use super::{arguments::SharedArgs, console::Console};
use crate::Result;

/// Show the version and the build
#[derive(Args)]
pub(super) struct Info {}

impl Info {
    pub(super) fn run(&self, _shared: &SharedArgs, console: &Console) -> Result<()> {
        let version = env!("CARGO_PKG_VERSION");
        let threads = rayon::current_num_threads();
        let value = serde_json::json!({
            "version": version,
            "threads": threads,
            "meshes": ["obj", "ply"],
            "sounds": ["wav", "mp3", "flac", "ogg", "m4a", "aiff"],
            "results": ["npz", "pc2", "mdd"],
        });
        console.value(&value, &format!("anyface {version}, {threads} threads"));
        Ok(())
    }
}
