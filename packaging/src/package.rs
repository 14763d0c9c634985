//! `cargo xtask package`: everything that is handed out for this machine's system, in one folder.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Result, ensure};
use clap::Args;

use crate::{
    debian, extension, install, licences,
    machine::{self, Platform},
    portable,
    steps::Steps,
    wheel,
};

/// Builds the extension's zip, the Python wheel, the C library as a tarball and, on Linux, a Debian
/// package.
#[derive(Args)]
pub struct Package {
    /// Folder of built libraries to take; without it they are built, on Linux for glibc 2.28.
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
        let built = match &self.library_dir {
            Some(folder) => folder.clone(),
            None => portable::build(&mut steps)?,
        };
        let out = self
            .out
            .clone()
            .unwrap_or(machine::target().join("package"));
        fs::create_dir_all(&out)?;
        let out = out.canonicalize()?;
        let platform = Platform::here()?;
        let zip = out.join(extension::zip_name(platform));
        let library = built.join(platform.shared_library());
        extension::build_zip(&mut steps, &library, &zip)?;
        let wheel = wheel::build(&mut steps, &library, &out)?;
        let mut made = vec![zip, wheel, tarball(&mut steps, &built, &out, platform)?];
        if platform == Platform::LinuxX64 && machine::has("dpkg-deb") {
            let package = debian::build(&mut steps, &built, &out)?;
            debian::check(&mut steps, &package)?;
            made.push(package);
        }
        for path in made {
            let size = fs::metadata(&path)?.len() as f64 / 1e6;
            println!("{size:6.1} MB {}", path.display());
        }
        steps.finish()
    }
}

/// Lays out the tarball: library, header, package files of pkg-config and CMake, licences.
fn stage(built: &Path, tree: &Path) -> Result<()> {
    machine::empty(tree)?;
    install::install(built, tree)?;
    licences::copy(tree)
}

/// Packs the C library and what belongs to it.
fn tarball(steps: &mut Steps, built: &Path, out: &Path, platform: Platform) -> Result<PathBuf> {
    let name = format!("anyface-{}-{}", env!("CARGO_PKG_VERSION"), platform.name());
    let folder = machine::target().join("tarball");
    let tree = folder.join(&name);
    stage(built, &tree)?;
    let path = out.join(format!("{name}.tar.gz"));
    let mut command = Command::new("tar");
    command
        .arg("-czf")
        .arg(&path)
        .arg("-C")
        .arg(&folder)
        .arg(&name);
    steps.run("pack the C library", &mut command)?;
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
        for name in [platform.shared_library(), library, "anyface.dll.lib"] {
            fs::write(built.join(name), name).unwrap();
        }
        stage(&built, &tree).unwrap();
        let names = ["lib", "include"].iter().chain(licences::FILES);
        let missing: Vec<_> = names.filter(|name| !tree.join(name).exists()).collect();
        assert!(missing.is_empty(), "{missing:?}");
        assert!(tree.join("lib").join(library).is_file());
        fs::remove_dir_all(folder).unwrap();
    }
}
