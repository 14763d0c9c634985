//! `cargo xtask web`: the library as WebAssembly, its npm package, and a page that makes heads
//! talk.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};
use clap::Args;

use crate::{cross::Target, machine, steps::Steps};

/// The target for browsers.
const BROWSERS: Target = Target {
    triple: "wasm32-unknown-unknown",
    standard_library: "std,panic_abort",
    linker: Some("wasm-ld"),
    packages: &[],
};
const PROFILE: &str = "web";
/// npm packages: one shows the head, the other bundles it into a single file.
const PACKAGES: [(&str, &str); 2] = [("three", "0.187.0"), ("esbuild", "0.25.12")];
/// A Node.js script that compresses a file with gzip, which every browser can unpack.
const PACK: &str = "const [from, to] = process.argv.slice(1), fs = require('fs'); \
    fs.writeFileSync(to, require('zlib').gzipSync(fs.readFileSync(from), {level: 9}));";

/// Writes target/web, which any static file server can serve. Its folder `anyface` is the npm
/// package.
#[derive(Args)]
pub struct Web {
    /// Also write the npm package as an archive.
    #[arg(long)]
    pack: bool,
}

impl Web {
    /// Builds the library and assembles the folder.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("web")?;
        let folder = build(&mut steps)?;
        if self.pack {
            let mut pack = npm();
            pack.arg("pack").current_dir(folder.join("anyface"));
            steps.run("npm pack", pack.arg("--pack-destination").arg(&folder))?;
        }
        println!("serve    {}", folder.display());
        steps.finish()
    }
}

/// The first program that the build needs and this machine lacks, if any.
pub fn missing() -> Option<&'static str> {
    let programs = ["node", "npm"];
    programs.into_iter().find(|program| !machine::has(program))
}

/// Debian packages that the build needs on this machine.
pub fn packages() -> Result<Vec<&'static str>> {
    BROWSERS.all_packages()
}

/// Builds the library, the npm package and the page. Returns the folder to serve.
pub fn build(steps: &mut Steps) -> Result<PathBuf> {
    if let Some(program) = missing() {
        bail!("expected {program} (Node.js), which fetches three.js and packs files; found none");
    }
    let library = library(steps)?;
    let bind = wasm_bindgen(steps)?;
    let folder = machine::target().join("web");
    machine::empty(&folder)?;
    let package = folder.join("anyface");
    steps.run(
        "wasm-bindgen",
        Command::new(bind)
            .args(["--target", "web", "--out-name", "anyface_web", "--out-dir"])
            .arg(&package)
            .arg(&library),
    )?;
    finish_package(steps, &package)?;
    page(&folder)?;
    three(steps, &folder)?;
    Ok(folder)
}

/// Builds the library for a single thread with SIMD.
fn library(steps: &mut Steps) -> Result<PathBuf> {
    let mut build = BROWSERS.cargo(steps, "build", "-Ctarget-feature=+simd128")?;
    build.args(["-p", "anyface-web", "--lib", "--profile", PROFILE]);
    steps.run("build for browsers", &mut build)?;
    Ok(BROWSERS.built(PROFILE).join("anyface_web.wasm"))
}

/// The program that generates the JavaScript for the library, in exactly the version that the
/// library uses. It is built only once.
fn wasm_bindgen(steps: &mut Steps) -> Result<PathBuf> {
    let lock = fs::read_to_string(machine::root().join("Cargo.lock"))?;
    let version = version_in(&lock, "wasm-bindgen").context("Cargo.lock: no wasm-bindgen")?;
    let root = machine::target().join("web-tools").join(version);
    let program = root.join("bin/wasm-bindgen");
    if !program
        .with_extension(std::env::consts::EXE_EXTENSION)
        .is_file()
    {
        let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
        let mut install = Command::new(cargo);
        install
            .args(["install", "wasm-bindgen-cli", "--version", version])
            .args(["--debug", "--root"])
            .arg(&root);
        steps.run("install wasm-bindgen", &mut install)?;
        machine::empty(&root.join("build"))?;
    }
    Ok(program)
}

/// The version of a crate in a Cargo.lock.
fn version_in<'a>(lock: &'a str, name: &str) -> Option<&'a str> {
    let (_, after) = lock.split_once(&format!("name = \"{name}\"\nversion = \""))?;
    after.split_once('"').map(|(version, _)| version)
}

/// Compresses the library and adds the models, types, licences and description to the npm package.
fn finish_package(steps: &mut Steps, package: &Path) -> Result<()> {
    let root = machine::root();
    let wasm = package.join("anyface_web_bg.wasm");
    let packed = package.join("anyface_web_bg.wasm.gz");
    let mut pack = Command::new("node");
    steps.run("pack", pack.args(["-e", PACK]).args([&wasm, &packed]))?;
    fs::remove_file(&wasm)?;
    fs::remove_file(package.join("anyface_web_bg.wasm.d.ts"))?;
    copy_files(&root.join("web/package"), package)?;
    for licence in ["LICENSE-MIT", "LICENSE-APACHE", "THIRD-PARTY.md"] {
        fs::copy(root.join(licence), package.join(licence))?;
    }
    let names = fs::read_to_string(root.join("web/models.txt"))?;
    for name in names.lines() {
        let folders = ["shared", "freetalk"].map(|data| root.join("weights").join(data).join(name));
        let from = folders.iter().find(|folder| folder.is_dir());
        let from = from.with_context(|| format!("web/models.txt: no model {name} in weights"))?;
        let to = package.join("models").join(name);
        fs::create_dir_all(&to)?;
        fs::copy(from.join("model.planes.gz"), to.join("model.planes.gz"))?;
    }
    Ok(())
}

/// Copies the page, its sample sentence and the default head.
fn page(folder: &Path) -> Result<()> {
    let root = machine::root();
    copy_files(&root.join("web/page"), folder)?;
    let sample = folder.join("sample");
    copy_files(&root.join("web/page/sample"), &sample)?;
    for name in ["head.obj", "landmarks.json"] {
        let from = root.join("weights/shared/default_head").join(name);
        fs::copy(from, sample.join(name))?;
    }
    Ok(())
}

/// Bundles what the page needs of three.js into one file.
fn three(steps: &mut Steps, folder: &Path) -> Result<()> {
    let packages = machine::target().join("web-npm");
    fs::create_dir_all(&packages)?;
    let modules = packages.join("node_modules");
    let is_here = |(name, version): (&str, &str)| {
        let known = fs::read_to_string(modules.join(name).join("package.json"));
        known.is_ok_and(|text| text.contains(&format!("\"version\": \"{version}\"")))
    };
    if !PACKAGES.into_iter().all(is_here) {
        let mut install = npm();
        install.args(["install", "--silent", "--no-save", "--no-audit", "--prefix"]);
        install.arg(&packages);
        install.args(PACKAGES.map(|(name, version)| format!("{name}@{version}")));
        steps.run("fetch three.js", &mut install)?;
    }
    let esbuild = if cfg!(windows) {
        "esbuild.cmd"
    } else {
        "esbuild"
    };
    let mut bundle = Command::new(modules.join(".bin").join(esbuild));
    bundle
        .arg(machine::root().join("web/three.js"))
        .args(["--bundle", "--minify", "--format=esm"])
        .arg("--legal-comments=inline")
        .arg(format!("--outfile={}", folder.join("three.js").display()))
        .env("NODE_PATH", &modules);
    steps.run("bundle three.js", &mut bundle)?;
    Ok(())
}

fn npm() -> Command {
    Command::new(if cfg!(windows) { "npm.cmd" } else { "npm" })
}

/// Copies the files of a folder, without its subfolders.
fn copy_files(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        if entry.file_type()?.is_file() {
            fs::copy(entry.path(), to.join(entry.file_name()))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_of_a_crate_is_that_of_its_own_name() {
        let lock = "name = \"wasm-bindgen-macro\"\nversion = \"1\"\n\nname = \"wasm-bindgen\"\nversion = \"2\"\n";
        assert_eq!(version_in(lock, "wasm-bindgen"), Some("2"));
        assert_eq!(version_in(lock, "wasm"), None);
    }
}
