//! Sets the name under which programs find the shared library. On Linux it contains the version
//! of the interface.

use std::env;

/// The only file that states the version.
const SOURCE: &str = "src/version.rs";

fn main() {
    println!("cargo::rerun-if-changed={SOURCE}");
    let system = env::var("CARGO_CFG_TARGET_OS");
    if system.as_deref() == Ok("macos") {
        // Without this its install name would be the path of the build folder.
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
    // A program then loads only the interface version that it was linked to.
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libanyface.so.{version}");
}
