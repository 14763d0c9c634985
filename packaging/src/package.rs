//! `cargo xtask package`: builds everything that is released for one system, in one folder.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Result, ensure};
use clap::Args;

use crate::{
    apt, debian, extension, install, licences, machine, platform::Platform, portable, steps::Steps,
    wheel,
};

/// Builds the extension's zip, the Python wheel, the command with the C library as a tarball and, for Linux, a Debian
/// package.
#[derive(Args)]
pub struct Package {
    /// The system, as Rust names it: x86_64-unknown-linux-gnu, aarch64-unknown-linux-gnu, aarch64-apple-darwin,
    /// x86_64-apple-darwin, x86_64-pc-windows-gnu; default: this one.
    #[arg(long, value_parser = Platform::of_words)]
    target: Option<Platform>,
    /// Profile of Cargo.toml: `demo` compiles faster than `release`, with the same results.
    #[arg(long, default_value = "release")]
    profile: String,
    /// Folder of built libraries to use; without it they are built, for Linux against glibc 2.28.
    #[arg(long)]
    library_dir: Option<PathBuf>,
    /// Where the packages go; default `target/package`.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Package {
    /// Builds, packs, checks.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("package")?;
        let platform = self.target.map_or_else(Platform::here, Ok)?;
        let built = match &self.library_dir {
            Some(folder) => folder.clone(),
            None => portable::build(&mut steps, platform, &self.profile)?,
        };
        let out = self
            .out
            .clone()
            .unwrap_or(machine::target().join("package"));
        fs::create_dir_all(&out)?;
        let out = out.canonicalize()?;
        let zip = out.join(extension::zip_name(platform));
        let library = built.join(platform.shared_library());
        extension::build_zip(&mut steps, &library, &zip)?;
        let wheel = wheel::build(&mut steps, &library, &out)?;
        pack_tighter(&mut steps, &[&zip, &wheel])?;
        let mut files = vec![zip, wheel, tarball(&mut steps, &built, &out, platform)?];
        if platform.is_linux() && machine::has("dpkg-deb") {
            let package = debian::build(&mut steps, platform, &built, &out)?;
            if platform == Platform::here()? {
                debian::check(&mut steps, &package)?;
            }
            files.push(package);
        }
        for path in files {
            let size = fs::metadata(&path)?.len() as f64 / 1e6;
            println!("{size:6.1} MB {}", path.display());
        }
        steps.finish()
    }
}

/// Compresses zips again, which makes them 1 % smaller than Python does. Leaves them as they are if
/// advzip is missing.
fn pack_tighter(steps: &mut Steps, zips: &[&Path]) -> Result<()> {
    apt::ensure(steps, &["advancecomp"])?;
    if !machine::has("advzip") {
        println!("note     no advzip is here: the zip and the wheel stay 1 % larger");
        return Ok(());
    }
    let mut pack = Command::new("advzip");
    // Use 7-Zip's compressor: Zopfli takes three times as long and saves nothing more.
    pack.args(["--recompress", "-3", "--quiet"]).args(zips);
    steps.run("pack the zip and the wheel tighter", &mut pack)?;
    Ok(())
}

/// Lays out the tarball: command, libraries, headers, package files of pkg-config and CMake, licences.
fn stage(platform: Platform, built: &Path, tree: &Path) -> Result<()> {
    machine::empty(tree)?;
    install::install(platform, built, tree)?;
    let command = built.join(platform.command());
    // The command is optional: a folder with only the libraries is enough.
    if command.is_file() {
        fs::create_dir_all(tree.join("bin"))?;
        fs::copy(command, tree.join("bin").join(platform.command()))?;
    }
    // The command and C hosts look for the microphone here. Not every system's is built.
    let microphone = built.join(platform.microphone_library());
    if microphone.is_file() {
        fs::copy(
            microphone,
            tree.join("lib").join(platform.microphone_library()),
        )?;
        let header = "include/anyface_microphone.h";
        fs::copy(machine::root().join(header), tree.join(header))?;
    }
    licences::copy(tree)
}

/// Packs the command, the C library and their other files as a tarball.
fn tarball(steps: &mut Steps, built: &Path, out: &Path, platform: Platform) -> Result<PathBuf> {
    let name = format!("anyface-{}-{}", env!("CARGO_PKG_VERSION"), platform.name());
    let folder = machine::target().join("tarball");
    let tree = folder.join(&name);
    stage(platform, built, &tree)?;
    let path = out.join(format!("{name}.tar.gz"));
    let mut command = Command::new("tar");
    command
        .arg("-czf")
        .arg(&path)
        .arg("-C")
        .arg(&folder)
        .arg(&name);
    steps.run("pack the command and the C library", &mut command)?;
    ensure!(path.is_file(), "tar wrote no {}", path.display());
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tarball_has_the_library_and_all_licences() {
        let folder = std::env::temp_dir().join(format!("anyface-tarball-{}", std::process::id()));
        let (built, tree) = (folder.join("built"), folder.join("tree"));
        fs::create_dir_all(&built).unwrap();
        let platform = Platform::here().unwrap();
        let library = platform.static_library();
        let command = platform.command();
        for name in [
            platform.shared_library(),
            library,
            platform.microphone_library(),
            "anyface.dll.lib",
            command,
        ] {
            fs::write(built.join(name), name).unwrap();
        }
        stage(platform, &built, &tree).unwrap();
        let names = ["lib", "include"].iter().chain(licences::FILES);
        let missing: Vec<_> = names.filter(|name| !tree.join(name).exists()).collect();
        assert!(missing.is_empty(), "{missing:?}");
        assert!(tree.join("lib").join(library).is_file());
        assert!(tree.join("bin").join(command).is_file());
        assert!(
            tree.join("lib")
                .join(platform.microphone_library())
                .is_file()
        );
        assert!(tree.join("include/anyface_microphone.h").is_file());
        fs::remove_dir_all(folder).unwrap();
    }
}
