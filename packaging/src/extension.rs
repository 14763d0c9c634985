//! `cargo xtask extension`: packs the Blender extension as one zip, with the native library (which
//! contains the default weights) and the licences. Blender's own tool checks it.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::{
    apt, licences, machine,
    platform::Platform,
    python::{PYTHON, Venv},
    steps::Steps,
};

/// Builds the extension's zip.
#[derive(Args)]
pub struct Extension {
    /// Take this library instead of building one.
    #[arg(long)]
    library: Option<PathBuf>,
    /// Build the optimised library, as for a release; takes minutes.
    #[arg(long)]
    release: bool,
    /// Where the zip goes; default `target/anyface-<version>-this-machine.zip`.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Extension {
    /// Builds the zip and prints its path.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("extension")?;
        let library = match &self.library {
            Some(path) => path.clone(),
            None => build_library(&mut steps, self.release)?,
        };
        let zip = self.out.clone().unwrap_or_else(default_zip);
        build_zip(&mut steps, &library, &zip)?;
        println!("{}", zip.display());
        Ok(())
    }
}

/// The usual path of a zip for this machine. Its library runs on systems like this one; older
/// systems may lack its glibc.
pub fn default_zip() -> PathBuf {
    machine::target().join(LOCAL_ZIP)
}

/// Differs from the name of a released zip.
const LOCAL_ZIP: &str = concat!("anyface-", env!("CARGO_PKG_VERSION"), "-this-machine.zip");

/// The name of the released zip.
pub fn zip_name(platform: Platform) -> String {
    format!(
        "anyface-{}-{}.zip",
        env!("CARGO_PKG_VERSION"),
        platform.name()
    )
}

/// Builds the shared library and returns its path.
pub fn build_library(steps: &mut Steps, release: bool) -> Result<PathBuf> {
    let profile = if release { "release" } else { "dev" };
    apt::ensure(steps, apt::SOUND)?;
    steps.run(BUILD, &mut library_build(profile))?;
    let library = library_of(profile)?;
    if release {
        machine::check_names_no_folder(&library)?;
    }
    Ok(library)
}

/// The name of the step that builds the library.
pub const BUILD: &str = "build the native library";

/// The command that builds the shared library under a profile of Cargo.toml.
///
/// Under `dev` it builds the whole workspace, as the Rust tests do. Cargo merges the features of
/// all packages that it builds together, so a build of the library alone would compile every
/// dependency again.
pub fn library_build(profile: &str) -> Command {
    let mut build = cargo_build(profile);
    match profile {
        "dev" => build.args(["--workspace", "--lib", "--bins", "--tests"]),
        "release" => build.args(["-p", "anyface-capi", "-p", "anyface-microphone"]),
        _ => build.args(["-p", "anyface-capi"]),
    };
    build
}

/// The command that builds the microphone library alone, which needs the packages `apt::SOUND`.
pub fn microphone_build(profile: &str) -> Command {
    let mut build = cargo_build(profile);
    build.args(["-p", "anyface-microphone"]);
    build
}

fn cargo_build(profile: &str) -> Command {
    let mut build = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    build.args(["build", "--profile", profile]);
    if profile != "dev" {
        // This library is put into a zip, which may be handed on.
        build.env("CARGO_ENCODED_RUSTFLAGS", machine::release_flags());
    }
    build.current_dir(machine::root());
    build
}

/// The path of the shared library that a profile builds.
pub fn library_of(profile: &str) -> Result<PathBuf> {
    let folder = if profile == "dev" { "debug" } else { profile };
    let name = Platform::here()?.shared_library();
    Ok(machine::target().join(folder).join(name))
}

/// Puts the extension, `library` and the licences into `zip`. Blender's tool checks it if Blender's
/// Python module is installed.
pub fn build_zip(steps: &mut Steps, library: &Path, zip: &Path) -> Result<()> {
    ensure!(library.is_file(), "no library at {}", library.display());
    let stage = machine::target().join("extension");
    if stage.exists() {
        fs::remove_dir_all(&stage)?;
    }
    copy_folder(&machine::root().join("blender-addon"), &stage)?;
    // The command has the same templates; `farm/export.py` looks for them here.
    copy_folder(
        &machine::root().join("cli/farm"),
        &stage.join("farm/engines"),
    )?;
    fs::write(stage.join(HELP), help()?)?;
    let platform = Platform::of_library(library)?;
    name_platform(&stage.join("blender_manifest.toml"), platform)?;
    copy_libraries(steps, library, &stage.join("lib"))?;
    licences::copy(&stage.join("licences"))?;
    pack(steps, &stage, zip)?;
    validate(steps, zip)
}

/// Copies `library` into `folder`, and the microphone library too if it lies beside `library`.
/// Returns the paths of the copies.
pub fn copy_libraries(steps: &mut Steps, library: &Path, folder: &Path) -> Result<Vec<PathBuf>> {
    fs::create_dir_all(folder)?;
    let platform = Platform::of_library(library)?;
    let mut copies = Vec::new();
    let microphone = library.with_file_name(platform.microphone_library());
    for (from, name) in [
        (library.to_owned(), platform.shared_library()),
        (microphone, platform.microphone_library()),
    ] {
        if from.is_file() {
            let copy = folder.join(name);
            fs::copy(from, &copy)?;
            strip(steps, &copy)?;
            copies.push(copy);
        }
    }
    Ok(copies)
}

/// The manual inside the zip. As .txt, because every system knows how to open that.
const HELP: &str = "help.txt";

/// The pages about Blender, one after the other.
fn help() -> Result<String> {
    let folder = machine::root().join("docs");
    let pages = [
        "blender",
        "blender-takes",
        "blender-feelings",
        "blender-faces",
    ];
    let pages = pages.map(|page| fs::read_to_string(folder.join(page).with_extension("md")));
    let pages: Vec<String> = pages.into_iter().collect::<Result<_, _>>()?;
    Ok(pages.join("\n"))
}

/// Writes the zip's platform into the manifest.
fn name_platform(manifest: &Path, platform: Platform) -> Result<()> {
    let text = fs::read_to_string(manifest)?;
    let line = format!("platforms = [\"{}\"]", Platform::LinuxX64.name());
    ensure!(
        text.contains(&line),
        "expected {line} in {}",
        manifest.display()
    );
    let this_platform = format!("platforms = [\"{}\"]", platform.name());
    fs::write(manifest, text.replace(&line, &this_platform))?;
    Ok(())
}

/// Removes debug information, which is most of an unoptimised library.
pub fn strip(steps: &mut Steps, library: &Path) -> Result<()> {
    let is_own = Platform::of_library(library)? == Platform::here()?;
    if !(is_own && cfg!(target_os = "linux") && machine::has("strip")) {
        return Ok(());
    }
    let mut command = Command::new("strip");
    command.arg("--strip-unneeded").arg(library);
    steps.run("strip the native library", &mut command)?;
    Ok(())
}

fn pack(steps: &mut Steps, stage: &Path, zip: &Path) -> Result<()> {
    if zip.exists() {
        fs::remove_file(zip)?;
    }
    let mut names = fs::read_dir(stage)?
        .map(|entry| Ok(entry?.file_name()))
        .collect::<Result<Vec<_>>>()?;
    names.sort();
    let mut command = Command::new(PYTHON);
    command.args(["-m", "zipfile", "-c"]).arg(absolute(zip)?);
    command.args(names).current_dir(stage);
    steps.run("zip the extension", &mut command)?;
    Ok(())
}

fn validate(steps: &mut Steps, zip: &Path) -> Result<()> {
    let Some(tool) = extension_tool() else {
        steps.ignore("validate the extension", "no bpy here");
        return Ok(());
    };
    let mut command = Command::new(Venv::Blender.python());
    command.arg(tool).arg("validate").arg(zip);
    steps.run("validate the extension", &mut command)?;
    Ok(())
}

/// `blender_ext.py` of the newest Blender in the Python environment.
pub fn extension_tool() -> Option<PathBuf> {
    let environment = Venv::Blender.python().ancestors().nth(2)?.to_owned();
    let folder = environment.join(if cfg!(windows) { "" } else { "lib" });
    let inside = |folder: &Path| -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).collect()
    };
    let pythons = inside(&folder);
    let versions = pythons
        .iter()
        .flat_map(|python| inside(&python.join("site-packages/bpy")));
    let mut tools: Vec<PathBuf> = versions
        .map(|version| version.join("scripts/addons_core/bl_pkg/cli/blender_ext.py"))
        .filter(|tool| tool.is_file())
        .collect();
    tools.sort();
    tools.pop()
}

/// Copies a folder, without what is no part of a package.
pub fn copy_folder(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from).with_context(|| format!("reading {}", from.display()))? {
        let entry = entry?;
        let name = entry.file_name();
        if name == "__pycache__" || name == "ruff.toml" || name == ".ruff_cache" || name == "lib" {
            continue;
        }
        if entry.file_type()?.is_dir() {
            copy_folder(&entry.path(), &to.join(name))?;
        } else {
            fs::copy(entry.path(), to.join(name))?;
        }
    }
    Ok(())
}

fn absolute(path: &Path) -> Result<PathBuf> {
    Ok(std::path::absolute(path)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_runs_here_alone_is_not_named_like_what_is_handed_out() {
        let local = default_zip();
        for platform in Platform::ALL {
            assert_ne!(local.file_name().unwrap(), zip_name(platform).as_str());
        }
    }

    #[test]
    fn libraries_in_a_zip_name_source_files_by_short_paths() {
        for (profile, is_short) in [("release", true), ("demo", true), ("dev", false)] {
            let build = library_build(profile);
            let mut variables = build.get_envs();
            let flags = variables.find_map(|(name, value)| {
                (name == "CARGO_ENCODED_RUSTFLAGS").then_some(value?.to_string_lossy())
            });
            let has_prefixes = flags.is_some_and(|flags| flags.contains("--remap-path-prefix="));
            assert_eq!(has_prefixes, is_short, "{profile}");
        }
    }
}
