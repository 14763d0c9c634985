//! Python environments under `target/venvs`, created if they are missing. Each has the interpreter
//! that its packages were built for.

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};

use crate::{
    apt,
    machine::{self, root, target},
    steps::Steps,
};

/// The Python on the PATH, outside of any environment.
pub const PYTHON: &str = if cfg!(windows) { "python" } else { "python3" };

/// The minor versions of Python 3 that Blender's modules are built for: first for Blender 4.2 to
/// 5.0, then for 5.1 and later.
const OF_BLENDER: [u32; 2] = [11, 13];

/// A Python environment of the project.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Venv {
    /// Blender as a module, pytest, ruff and mypy.
    Blender,
    /// PyTorch and what else training needs.
    Training,
    /// Zig, which links for older systems.
    Packaging,
    /// Dask, and packages that read the jobs exported to render farms.
    Farm,
}

impl Venv {
    fn folder(self) -> &'static str {
        match self {
            Venv::Blender => "bpy",
            Venv::Training => "training",
            Venv::Packaging => "packaging",
            Venv::Farm => "farm",
        }
    }

    /// The file whose lines pip installs; its text decides whether the environment is current.
    fn requirements(self) -> PathBuf {
        match self {
            Venv::Blender => root().join("tests/addon/requirements.txt"),
            Venv::Training => root().join("training/requirements.txt"),
            Venv::Packaging => root().join("packaging/requirements.txt"),
            Venv::Farm => root().join("tests/farm/requirements.txt"),
        }
    }

    /// Its interpreter; `ANYFACE_VENVS` moves all environments to another folder.
    pub fn python(self) -> PathBuf {
        interpreter(self.folder())
    }

    /// Creates or refreshes the environment.
    pub fn ensure(self, steps: &mut Steps) -> Result<PathBuf> {
        let packages = std::fs::read_to_string(self.requirements())
            .with_context(|| format!("reading {}", self.requirements().display()))?;
        if is_current(self.folder(), &packages) {
            return Ok(self.python());
        }
        let from = match self {
            Venv::Blender => any_of_blender()?,
            _ => PYTHON.to_owned(),
        };
        environment(steps, &from, self.folder(), &packages)
    }
}

/// A Python with Blender as a module, in the usual version or in another `version` such as "4.2".
pub fn blender(steps: &mut Steps, version: Option<&str>) -> Result<PathBuf> {
    let Some(version) = version else {
        return Venv::Blender.ensure(steps);
    };
    let usual = std::fs::read_to_string(Venv::Blender.requirements())?;
    let name = format!("bpy-{version}");
    let packages = of_version(&usual, version);
    if is_current(&name, &packages) {
        return Ok(interpreter(&name));
    }
    let from = first_of(&[python_for(version)?])?;
    environment(steps, &from, &name, &packages)
}

/// The interpreter of an environment; `ANYFACE_VENVS` moves all to another folder.
fn interpreter(name: &str) -> PathBuf {
    let base = std::env::var_os("ANYFACE_VENVS").map_or(target().join("venvs"), PathBuf::from);
    let inside = if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    };
    base.join(name).join(inside)
}

/// The folder of an environment.
fn folder(name: &str) -> Result<PathBuf> {
    let python = interpreter(name);
    let folder = python.ancestors().nth(2).context("venv path")?;
    Ok(folder.to_owned())
}

/// Whether an environment was installed from exactly these lines of `packages`.
fn is_current(name: &str, packages: &str) -> bool {
    let Ok(folder) = folder(name) else {
        return false;
    };
    std::fs::read_to_string(folder.join("installed.txt")).is_ok_and(|text| text == packages)
}

/// Creates or refreshes an environment with the interpreter `from`. `packages` are lines for pip.
fn environment(steps: &mut Steps, from: &str, name: &str, packages: &str) -> Result<PathBuf> {
    let (python, folder) = (interpreter(name), folder(name)?);
    // Debian's python3 comes without ensurepip.
    let complete = Command::new(from).args(["-c", "import ensurepip"]).output();
    if !complete.is_ok_and(|out| out.status.success()) {
        apt::ensure(steps, &["python3-venv"])?;
    }
    let mut create = Command::new(from);
    create.args(["-m", "venv"]).arg(&folder);
    if minor_of(&python) != minor_of(from) {
        create.arg("--clear");
    }
    steps.run(&format!("make a Python environment ({name})"), &mut create)?;
    let list = folder.join("wanted.txt");
    std::fs::write(&list, packages)?;
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "-q", "-U", "pip"]);
    steps.run(&format!("update pip ({name})"), &mut pip)?;
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "-r"]).arg(list);
    steps.run(&format!("install Python packages ({name})"), &mut pip)?;
    std::fs::write(folder.join("installed.txt"), packages)?;
    Ok(python)
}

/// An interpreter for which there is a Blender module: `python3` itself if its version fits.
fn any_of_blender() -> Result<String> {
    first_of(&OF_BLENDER)
}

/// The first interpreter on the PATH that is Python 3 in one of the minor versions `minors`.
fn first_of(minors: &[u32]) -> Result<String> {
    let usual = minor_of(PYTHON);
    if usual.is_some_and(|minor| minors.contains(&minor)) {
        return Ok(PYTHON.to_owned());
    }
    let named = minors
        .iter()
        .map(|minor| (minor, format!("python3.{minor}")));
    for (minor, name) in named {
        if minor_of(&name) == Some(*minor) {
            return Ok(name);
        }
    }
    let versions: Vec<String> = minors.iter().map(|minor| format!("3.{minor}")).collect();
    let version = usual.map_or("none".to_owned(), |minor| format!("3.{minor}"));
    bail!(
        "Blender's Python module needs Python {}, and {PYTHON} is {version}: install one of them \
         (Debian 12 has 3.11, Debian 13 has 3.13) so that it is on the PATH",
        versions.join(" or ")
    )
}

/// The minor version of an interpreter. `None` if it does not run.
fn minor_of(name: impl AsRef<OsStr>) -> Option<u32> {
    let ask = "import sys; print(sys.version_info.minor)";
    let output = Command::new(name).args(["-c", ask]).output().ok()?;
    String::from_utf8(output.stdout).ok()?.trim().parse().ok()
}

/// The minor version of the Python 3 that a version of Blender was built for.
fn python_for(version: &str) -> Result<u32> {
    let numbers = version
        .split_once('.')
        .and_then(|(major, minor)| Some((major.parse::<u32>().ok()?, minor.parse::<u32>().ok()?)));
    let Some(numbers) = numbers else {
        bail!("expected a version of Blender such as 4.2, got {version}");
    };
    Ok(OF_BLENDER[usize::from(numbers >= (5, 1))])
}

/// The lines for pip, with another version of bpy.
fn of_version(lines: &str, version: &str) -> String {
    let others = lines.lines().filter(|line| !line.starts_with("bpy=="));
    let others: String = others.map(|line| format!("{line}\n")).collect();
    format!("bpy=={version}.*\n{others}")
}

/// Runs pytest on one folder, with the shared data. Uses one process per core, at most four; the
/// tests of a file all run in the same process.
pub fn pytest(python: &Path, folder: &str) -> Command {
    let mut command = Command::new(python);
    command.args(["-m", "pytest", "-q", "-p", "no:cacheprovider", folder]);
    let processes = std::thread::available_parallelism().map_or(1, |cores| cores.get().min(4));
    command.args(["--dist", "loadfile", "-n", &processes.to_string()]);
    // Delete the files of tests that passed: they would fill the disk.
    command.args(["-o", "tmp_path_retention_policy=failed"]);
    // Otherwise NumPy and PyTorch use all cores in each process.
    command.env("OMP_NUM_THREADS", "1");
    command.current_dir(machine::root());
    if let Some(shared) = machine::shared() {
        command.env("ANYFACE_SHARED", shared);
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_blender_changes_its_own_lines_and_the_python() {
        let usual =
            "bpy==5.0.1; python_version < '3.13'\nbpy==5.2.3; python_version >= '3.13'\npytest\n";
        assert_eq!(of_version(usual, "4.2"), "bpy==4.2.*\npytest\n");
        assert_eq!(python_for("5.0").unwrap(), 11);
        assert_eq!(python_for("5.2").unwrap(), 13);
        assert!(python_for("five").unwrap_err().to_string().contains("five"));
    }

    #[test]
    fn a_missing_python_is_named_with_the_one_that_is_there() {
        let words = first_of(&[99]).unwrap_err().to_string();
        assert!(words.contains("needs Python 3.99"), "{words}");
    }
}
