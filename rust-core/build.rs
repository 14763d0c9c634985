//! Names the code that what is kept of a mesh was made by, so that it never outlives it.

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
