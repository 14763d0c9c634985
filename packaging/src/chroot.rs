//! Programs that this Debian has not, or not new enough: those of another one, in a folder of their own.

use std::{path::PathBuf, process::Command};

use anyhow::Result;

use crate::{apt, machine, steps::Steps};

/// A program of another Debian.
pub struct Program {
    /// What it is called, for people.
    title: &'static str,
    /// Names an executable of the caller's that is used instead.
    variable: &'static str,
    suite: &'static str,
    /// Its name in `/usr/bin`.
    name: &'static str,
    packages: &'static [&'static str],
}

/// Blender that knows extensions, and a display of its own.
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

/// Windows' programs on Linux; older ones lack a library that Rust's programs need.
pub const WINE: Program = Program {
    title: "Wine",
    variable: "ANYFACE_WINE",
    suite: "trixie",
    name: "wine",
    packages: &["wine", "wine64"],
};

impl Program {
    /// Its executable, installed where it is missing; none where that is not possible.
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
        // It mounts /tmp in its folder, which some containers forbid.
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
