//! Names the shared library by the version of its interface.

use std::env;

/// Holds the version, of which there is but this one place.
const SOURCE: &str = "src/version.rs";

fn main() {
    println!("cargo::rerun-if-changed={SOURCE}");
    let system = env::var("CARGO_CFG_TARGET_OS");
    if system.as_deref() == Ok("macos") {
        // Else it is named after the folder that it was built in.
        println!("cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libanyface.dylib");
    }
    if system.as_deref() != Ok("linux") {
        return;
    }
    let text = std::fs::read_to_string(SOURCE).expect("the crate holds its version");
    let version = text
        .split_once("ANYFACE_ABI_VERSION: u32 = ")
        .and_then(|(_, rest)| rest.split_once(';'))
        .map(|(version, _)| version)
        .expect("the version stands where it is declared");
    // A program then looks for the interface that it was linked to, not for any.
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libanyface.so.{version}");
}
