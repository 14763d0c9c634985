//! Puts a hash of the per-mesh code into the library. A cached face never outlives its code.

#[path = "build/sources.rs"]
mod sources;

use std::{io, path::Path};

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=build");
    for source in sources::SOURCES {
        println!("cargo::rerun-if-changed={source}");
    }
    let digest = sources::digest(Path::new(""))?;
    println!("cargo::rustc-env=ANYFACE_SOURCES={digest}");
    Ok(())
}
