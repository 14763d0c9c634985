//! Builds the libraries and the command for release: for this system or another, and for older
//! versions than the system that builds them.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::Result;

use crate::{apt, machine, platform::Platform, steps::Steps, symbols};

/// Builds the C library (shared and static), the microphone library and the command. Returns their
/// folder.
///
/// The microphone library is left out if this machine lacks the sound headers of the other system.
pub fn build(steps: &mut Steps, platform: Platform, profile: &str) -> Result<PathBuf> {
    let has_sound = platform == Platform::here()? || platform == Platform::WindowsX64;
    if has_sound && platform.is_linux() {
        apt::ensure(steps, apt::SOUND)?;
    } else if !has_sound {
        let name = platform.name();
        println!("note     no sound system of {name} is here: built without microphone");
    }
    // Build the command separately: cargo merges the features of packages that it builds together,
    // and the library uses fewer.
    let mut libraries = cargo(steps, platform, profile)?;
    libraries.args(["-p", "anyface-capi"]);
    if has_sound {
        libraries.args(["-p", "anyface-microphone"]);
    }
    let name = platform.name();
    steps.run(&format!("build the libraries for {name}"), &mut libraries)?;
    let built = platform.target().built(profile);
    let library = built.join(platform.shared_library());
    symbols::check(platform, &library)?;
    machine::check_names_no_folder(&library)?;
    let mut command = cargo(steps, platform, profile)?;
    command.args(["-p", "anyface-cli"]);
    steps.run(&format!("build the command for {name}"), &mut command)?;
    if platform == Platform::WindowsX64 && !cfg!(windows) {
        import_library(steps, &built)?;
    }
    Ok(built)
}

/// Cargo's build command for a release.
fn cargo(steps: &mut Steps, platform: Platform, profile: &str) -> Result<Command> {
    let target = platform.target();
    let is_zigs = cfg!(target_os = "linux") && platform != Platform::WindowsX64;
    let mut build = if is_zigs {
        target.cargo_for_old_systems(steps)?
    } else {
        target.cargo(steps, "build", "")?
    };
    build.args(["--profile", profile]);
    Ok(build)
}

/// Writes the import library, named as Microsoft's tools do. Their linker and GNU's can both read
/// it.
fn import_library(steps: &mut Steps, built: &Path) -> Result<()> {
    let names = symbols::exported(&built.join("anyface.dll"))?;
    let definitions = built.join("anyface.def");
    let text = format!("LIBRARY anyface.dll\nEXPORTS\n{}\n", names.join("\n"));
    fs::write(&definitions, text)?;
    let mut write = Command::new("x86_64-w64-mingw32-dlltool");
    write.current_dir(built).args([
        "--machine=i386:x86-64",
        "--input-def=anyface.def",
        "--dllname=anyface.dll",
        "--output-lib=anyface.dll.lib",
    ]);
    steps.run("write the import library", &mut write)?;
    Ok(())
}
