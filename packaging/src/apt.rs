//! Installs Debian packages that are missing.

use std::process::Command;

use anyhow::{Result, bail, ensure};

use crate::{
    machine::{has, is_root},
    steps::Steps,
};

/// Libraries that Blender's Python wheel links against.
pub const BLENDER_LIBRARIES: &[&str] = &[
    "libx11-6",
    "libxrender1",
    "libxfixes3",
    "libxi6",
    "libxext6",
    "libxkbcommon0",
    "libsm6",
    "libice6",
    "libgl1",
];

/// Packages that the microphone library is compiled against.
pub const SOUND: &[&str] = &["libasound2-dev", "pkg-config"];

/// Installs Debian packages that are missing.
pub fn ensure(steps: &mut Steps, packages: &[&str]) -> Result<()> {
    if !cfg!(target_os = "linux") {
        return Ok(());
    }
    let missing: Vec<&str> = packages.iter().copied().filter(|p| !installed(p)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    ensure!(
        has("apt-get"),
        "needs the packages {}, and there is no apt-get to install them",
        missing.join(" ")
    );
    let mut prefix: Vec<&str> = Vec::new();
    if !is_root() {
        if !has("sudo") {
            bail!("needs root once: apt-get install {}", missing.join(" "));
        }
        prefix.push("sudo");
    }
    let mut install = vec!["install", "-y", "-q", "--no-install-recommends"];
    install.extend(&missing);
    let name = format!("install {}", missing.join(" "));
    for (name, arguments) in [
        ("read Debian's list of packages", vec!["update", "-q"]),
        (&name, install),
    ] {
        let words: Vec<&str> = prefix.iter().copied().chain(["apt-get"]).collect();
        let mut command = Command::new(words[0]);
        command.args(&words[1..]).args(arguments);
        steps.run(name, command.env("DEBIAN_FRONTEND", "noninteractive"))?;
    }
    Ok(())
}

fn installed(package: &str) -> bool {
    Command::new("dpkg-query")
        .args(["-W", "-f=${Status}", package])
        .output()
        .is_ok_and(|out| String::from_utf8_lossy(&out.stdout).contains("install ok installed"))
}
