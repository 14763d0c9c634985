//! The files to publish, sorted by kind, and the folders of the site that hold them.

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail, ensure};
use sha2::{Digest, Sha256};

use super::frame;
use crate::{extension, platform::Platform, python::Venv, steps::Steps};

const EXTENSIONS_PAGE: &str = include_str!("../../site/extensions.html");

/// The files to publish. Each list is sorted by name, but the npm package comes last.
#[derive(Default)]
pub struct Parts {
    /// Zips of the Blender extension.
    pub extensions: Vec<PathBuf>,
    /// Wheels of the Python package.
    pub wheels: Vec<PathBuf>,
    /// Everything else: C libraries, Debian packages, the npm package.
    pub downloads: Vec<PathBuf>,
    /// Address of a page that has the downloads, if they are not part of the site.
    pub downloads_page: Option<String>,
    /// The folder with the page for browsers.
    pub web: Option<PathBuf>,
}

impl Parts {
    /// Sorts the files in `packages` into kinds by their names. Adds the page and the npm package
    /// in `web`.
    pub fn find(packages: &Path, web: &Path) -> Result<Self> {
        ensure!(
            packages.is_dir(),
            "no packages at {}: run `cargo xtask package`, or name a folder by --packages",
            packages.display()
        );
        let mut parts = Parts::default();
        for path in files(packages)? {
            match path.extension().and_then(|ending| ending.to_str()) {
                Some("zip") if system_of(&path).is_some() => parts.extensions.push(path),
                Some("whl") => parts.wheels.push(path),
                _ => parts.downloads.push(path),
            }
        }
        if web.join("index.html").is_file() {
            let archives = files(web)?.into_iter();
            parts.downloads.extend(archives.filter(|path| is_npm(path)));
            parts.web = Some(web.to_owned());
        }
        Ok(parts)
    }

    /// Copies everything into the folder of a site and writes the lists that Blender and pip read.
    pub fn write(&self, steps: &mut Steps, out: &Path) -> Result<()> {
        if !self.extensions.is_empty() {
            let folder = out.join("extensions");
            copy_all(&self.extensions, &folder)?;
            list_extensions(steps, &folder, self.extensions.len())?;
        }
        if !self.wheels.is_empty() {
            // PEP 503: one page lists the projects, and one page for each project lists its files.
            let folder = out.join("wheels");
            copy_all(&self.wheels, &folder.join("anyface"))?;
            let projects = "<a href=\"anyface/\">anyface</a>";
            fs::write(folder.join("index.html"), frame::list("Wheels", projects))?;
            let links = wheel_links(&self.wheels)?;
            let page = frame::list("Wheels of anyface", &links);
            fs::write(folder.join("anyface/index.html"), page)?;
        }
        if self.downloads_page.is_none() && !self.downloads.is_empty() {
            let folder = out.join("downloads");
            copy_all(&self.downloads, &folder)?;
            let mut sums = String::new();
            for path in &self.downloads {
                writeln!(sums, "{}  {}", sha256(path)?, name(path))?;
            }
            fs::write(folder.join("SHA256SUMS"), sums)?;
        }
        if let Some(web) = &self.web {
            copy_page(web, &out.join("web"))?;
        }
        Ok(())
    }

    /// Describes the parts of a complete release that are missing here.
    pub fn missing(&self) -> Vec<String> {
        let mut missing = Vec::new();
        for platform in Platform::ALL {
            let (system, (begin, end)) = (platform.name(), platform.wheel_tag());
            let has = |paths: &[PathBuf]| paths.iter().any(|path| system_of(path) == Some(system));
            if !has(&self.extensions) {
                missing.push(format!("the Blender extension for {system}"));
            }
            let is_wheel = |path: &PathBuf| is_tagged(&name(path), begin, end);
            if !self.wheels.iter().any(is_wheel) {
                missing.push(format!("the Python wheel for {system}"));
            }
            if !has(&self.downloads) {
                missing.push(format!("the C library for {system}"));
            }
        }
        let ends = |ending: &str| {
            self.downloads
                .iter()
                .any(|path| name(path).ends_with(ending))
        };
        if !ends(".deb") {
            missing.push("the Debian package".to_owned());
        }
        if !self.downloads.iter().any(|path| is_npm(path)) {
            missing.push("the npm package (`cargo xtask web --pack`)".to_owned());
        }
        if self.web.is_none() {
            missing.push("the page for browsers (`cargo xtask web`)".to_owned());
        }
        missing
    }
}

/// The last part of a path.
pub fn name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// The system at the end of an archive's name: `anyface-0.1.0-linux-x64.zip`.
pub fn system_of(path: &Path) -> Option<&'static str> {
    let name = name(path);
    let stem = [".zip", ".tar.gz"]
        .iter()
        .find_map(|end| name.strip_suffix(end))?;
    let mut systems = Platform::ALL.into_iter().map(Platform::name);
    systems.find(|system| stem.ends_with(&format!("-{system}")))
}

fn is_npm(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "tgz")
}

/// Whether one of a wheel's tags has this beginning and end: `…-manylinux_2_28_x86_64.whl`.
fn is_tagged(name: &str, begin: &str, end: &str) -> bool {
    let tags = name.trim_end_matches(".whl").rsplit('-').next();
    let mut tags = tags.unwrap_or_default().split('.');
    tags.any(|tag| tag.starts_with(begin) && tag.ends_with(&format!("_{end}")))
}

/// The files directly in a folder, sorted by name.
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))?;
    let paths = entries
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<Vec<_>>>()?;
    let mut files: Vec<PathBuf> = paths.into_iter().filter(|path| path.is_file()).collect();
    files.sort();
    Ok(files)
}

fn copy_all(paths: &[PathBuf], folder: &Path) -> Result<()> {
    fs::create_dir_all(folder)?;
    for path in paths {
        let to = folder.join(name(path));
        fs::copy(path, to).with_context(|| format!("copying {}", path.display()))?;
    }
    Ok(())
}

/// Copies the page's folder with its subfolders, but without the npm archive.
fn copy_page(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let path = entry?.path();
        let copy = to.join(name(&path));
        match path.is_dir() {
            true => copy_page(&path, &copy)?,
            false if is_npm(&path) => {}
            false => drop(fs::copy(&path, copy)?),
        }
    }
    Ok(())
}

/// Writes `index.json`, which Blender reads, and a page with links to drop into Blender.
fn list_extensions(steps: &mut Steps, folder: &Path, count: usize) -> Result<()> {
    let python = Venv::Blender.ensure(steps)?;
    let tool = extension::extension_tool().context("no blender_ext.py in Blender's module")?;
    let template = folder.join("template.html");
    fs::write(&template, EXTENSIONS_PAGE)?;
    let mut generate = Command::new(python);
    generate
        .arg(tool)
        .args(["server-generate", "--html", "--repo-dir"]);
    generate.arg(folder).arg("--html-template").arg(&template);
    let output = steps.run("list the extensions", &mut generate)?;
    fs::remove_file(template)?;
    // The tool carries on if it cannot read a zip or finds two for the same system.
    let list = fs::read_to_string(folder.join("index.json"))?;
    let list: serde_json::Value = serde_json::from_str(&list)?;
    let listed = list["data"].as_array().map_or(0, Vec::len);
    if listed != count || output.contains("duplicates") {
        bail!("expected {count} extensions, each for a system of its own, got {listed}:\n{output}");
    }
    Ok(())
}

/// One link for each wheel, with the digest and the Python version that pip checks.
fn wheel_links(wheels: &[PathBuf]) -> Result<String> {
    let mut links = String::new();
    for path in wheels {
        let (name, sum) = (name(path), sha256(path)?);
        writeln!(
            links,
            "<a href=\"{name}#sha256={sum}\" data-requires-python=\"&gt;=3.10\">{name}</a><br>"
        )?;
    }
    Ok(links)
}

fn sha256(path: &Path) -> Result<String> {
    let bytes = fs::read(path).with_context(|| format!("reading {}", path.display()))?;
    let digest = Sha256::digest(bytes);
    Ok(digest.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_for_which_system_a_package_is() {
        let system = |name: &str| system_of(Path::new(name));
        assert_eq!(system("p/anyface-0.1.0-linux-x64.zip"), Some("linux-x64"));
        assert_eq!(system("anyface-0.1.0-macos-x64.tar.gz"), Some("macos-x64"));
        assert_eq!(system("anyface-0.1.0-this-machine.zip"), None);
        let wheel = "anyface-0.1.0-py3-none-manylinux_2_28_x86_64.whl";
        let fits = Platform::ALL.map(|platform| {
            let (begin, end) = platform.wheel_tag();
            is_tagged(wheel, begin, end)
        });
        assert_eq!(fits, [true, false, false, false, false]);
        let mac = "anyface-0.1.0-py3-none-macosx_11_0_arm64.whl";
        assert!(is_tagged(mac, "macosx", "arm64") && !is_tagged(mac, "macosx", "x86_64"));
    }

    #[test]
    fn what_is_missing_is_said_and_what_is_there_is_not() {
        let everything = Parts {
            extensions: Platform::ALL
                .map(|platform| format!("anyface-1-{}.zip", platform.name()).into())
                .to_vec(),
            wheels: Platform::ALL
                .map(|platform| {
                    let (begin, end) = platform.wheel_tag();
                    format!("a-1-py3-none-{begin}_{end}.whl").into()
                })
                .to_vec(),
            downloads: Platform::ALL
                .map(|platform| PathBuf::from(format!("anyface-1-{}.tar.gz", platform.name())))
                .into_iter()
                .chain(["anyface-1.tgz".into(), "libanyface-dev_1_amd64.deb".into()])
                .collect(),
            web: Some("web".into()),
            ..Parts::default()
        };
        assert_eq!(everything.missing(), Vec::<String>::new());
        let nothing = Parts::default().missing();
        assert_eq!(nothing.len(), 3 * Platform::ALL.len() + 3);
        let lines = nothing.join("\n");
        assert!(
            lines.contains("the Python wheel for linux-arm64"),
            "{lines}"
        );
    }
}
