//! `cargo xtask package`: everything that is handed out for this machine's system, in one folder.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Result, ensure};
use clap::Args;

use crate::{
    debian, extension, install,
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

/// Library, header, package files of pkg-config and CMake, licences.
fn tarball(steps: &mut Steps, built: &Path, out: &Path, platform: Platform) -> Result<PathBuf> {
    let name = format!("anyface-{}-{}", env!("CARGO_PKG_VERSION"), platform.name());
    let stage = machine::target().join("tarball");
    let tree = stage.join(&name);
    machine::empty(&tree)?;
    install::install(built, &tree)?;
    install::copy_licences(&tree)?;
    let path = out.join(format!("{name}.tar.gz"));
    let mut command = Command::new("tar");
    command
        .arg("-czf")
        .arg(&path)
        .arg("-C")
        .arg(&stage)
        .arg(&name);
    steps.run("pack the C library", &mut command)?;
    ensure!(path.is_file(), "tar wrote no {}", path.display());
    Ok(path)
}
