//! Installs programs that this Debian lacks, or has in too old a version, from another Debian suite
//! into a folder of their own.

use std::{path::PathBuf, process::Command};

use anyhow::Result;

use crate::{apt, machine, steps::Steps};

/// A program from another Debian suite.
pub struct Program {
    /// Its name in messages.
    title: &'static str,
    /// The environment variable in which the caller can name an executable to use instead.
    variable: &'static str,
    suite: &'static str,
    /// Its name in `/usr/bin`.
    name: &'static str,
    packages: &'static [&'static str],
}

/// A Blender that supports extensions, with a display of its own.
pub const BLENDER: Program = Program {
    title: "Blender",
    variable: "ANYFACE_BLENDER",
    suite: "trixie",
    name: "blender",
    packages: &[
        "blender",
        "python3-numpy",
        "xvfb",
        "libgl1-mesa-dri",
        "xdotool",
        "imagemagick",
    ],
};

/// The game engine, version 4.
pub const GODOT: Program = Program {
    title: "Godot",
    variable: "ANYFACE_GODOT",
    suite: "forky",
    name: "godot",
    packages: &["godot"],
};

/// Runs Windows programs on Linux. Older versions lack a library that Rust's programs need.
pub const WINE: Program = Program {
    title: "Wine",
    variable: "ANYFACE_WINE",
    suite: "trixie",
    name: "wine",
    packages: &["wine", "wine64"],
};

impl Program {
    /// Its executable, installed if missing. `None` if it cannot be installed or does not run here.
    pub fn executable(&self, steps: &mut Steps) -> Result<Option<PathBuf>> {
        if let Some(path) = std::env::var_os(self.variable) {
            return Ok(Some(path.into()));
        }
        if !machine::is_root() {
            println!(
                "note     not root: no executable of {} is installed for its test",
                self.title
            );
            return Ok(None);
        }
        apt::ensure(steps, &["debootstrap"])?;
        let folder = machine::target().join(format!("{}-chroot", self.name));
        let mut install = Command::new(machine::root().join("packaging/chroot.sh"));
        install.arg(&folder).args([self.suite, self.name]);
        let title = format!("install an executable of {}", self.title);
        steps.run(&title, install.args(self.packages))?;
        let executable = folder.canonicalize()?.join(format!("run-{}", self.name));
        // The executable mounts /tmp in its folder, which some containers forbid.
        let trial = Command::new(&executable).arg("--version").output()?;
        if !trial.status.success() {
            let why = String::from_utf8_lossy(&trial.stderr).trim().to_owned();
            let tests = format!("tests with an executable of {}", self.title);
            steps.ignore(&tests, &why);
            return Ok(None);
        }
        Ok(Some(executable))
    }
}
