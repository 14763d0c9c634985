//! Finds the tools that some tests need. Without them those tests count as ignored, not as passed.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo::rerun-if-env-changed=PATH");
    for tool in ["valgrind", "cmake", "pkg-config", "dpkg-deb"] {
        let cfg = format!("has_{}", tool.replace('-', "_"));
        println!("cargo::rustc-check-cfg=cfg({cfg})");
        let place = find(tool);
        // A missing path makes cargo run this script again next time.
        let watched = place
            .clone()
            .unwrap_or_else(|| PathBuf::from("/usr/bin").join(tool));
        println!("cargo::rerun-if-changed={}", watched.display());
        if place.is_some() {
            println!("cargo::rustc-cfg={cfg}");
        }
    }
}

fn find(tool: &str) -> Option<PathBuf> {
    let folders = env::var_os("PATH")?;
    env::split_paths(&folders)
        .map(|folder| folder.join(tool))
        .find(|path| path.is_file())
}
