//! The machine: its system and the folders of the repository.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};

/// The root folder of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map(Path::to_owned)
        .unwrap_or_default()
}

/// Cargo's build folder.
pub fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or(root().join("target"), PathBuf::from)
}

/// The flags of rustc for released files, after the caller's own flags. They make messages name
/// source files by short paths instead of their paths on this machine.
pub fn release_flags() -> String {
    let [crates, rust] = ["CARGO_HOME", "RUSTUP_HOME"].map(std::env::var_os);
    let home = std::env::home_dir().unwrap_or_default();
    let crates = crates.map_or(home.join(".cargo"), PathBuf::from);
    let rust = rust.map_or(home.join(".rustup"), PathBuf::from);
    let workspace = root().canonicalize().unwrap_or(root());
    let target = std::path::absolute(target()).unwrap_or(target());
    // rustc uses the last prefix that matches, so a folder comes after the folders around it.
    let names = [
        (home, "home"),
        (crates, "crates"),
        (rust, "rust"),
        (workspace, "anyface"),
        (target, "target"),
    ];
    let flags = names.map(|(path, name)| format!("--remap-path-prefix={}={name}", path.display()));
    // Cargo separates these with the unit separator, so that paths may contain spaces.
    let flags_of_caller = std::env::var("CARGO_ENCODED_RUSTFLAGS").ok();
    let plain = || {
        std::env::var("RUSTFLAGS")
            .ok()
            .map(|flags| flags.replace(' ', "\x1f"))
    };
    let flags_of_caller = flags_of_caller
        .or_else(plain)
        .filter(|flags| !flags.is_empty());
    flags_of_caller
        .into_iter()
        .chain(flags)
        .collect::<Vec<_>>()
        .join("\x1f")
}

/// The first folder of this machine whose path a file contains, if any.
pub fn named_folder(file: &Path) -> Result<Option<PathBuf>> {
    let bytes = fs::read(file).with_context(|| format!("reading {}", file.display()))?;
    let crates = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let folders = [std::env::home_dir(), crates, root().canonicalize().ok()];
    let mut folders = folders.into_iter().flatten();
    Ok(folders.find(|folder| {
        // Short paths such as `/` occur in every file.
        let name = folder.as_os_str().as_encoded_bytes();
        let name = [name, b"/"].concat();
        name.len() > 3 && bytes.windows(name.len()).any(|window| window == name)
    }))
}

/// Fails if a file contains the path of a folder of this machine.
pub fn check_names_no_folder(file: &Path) -> Result<()> {
    match named_folder(file)? {
        None => Ok(()),
        Some(folder) => bail!(
            "{}: expected no path of this machine, got {}",
            file.display(),
            folder.display()
        ),
    }
}

/// Third-party data for the tests that need it; not part of a clone.
pub fn shared() -> Option<PathBuf> {
    let folder = std::env::var_os("ANYFACE_SHARED").map_or(root().join("../shared"), PathBuf::from);
    folder.join("data").is_dir().then_some(folder)
}

/// Prints a note if the disk has less room than a first run takes: the run may then fail midway.
pub fn note_room(gigabytes: u64) {
    let free = fs4::available_space(root()).unwrap_or(u64::MAX) / 1_000_000_000;
    if free < gigabytes {
        println!("note     {free} GB of disk are free; a first run takes {gigabytes}");
    }
}

/// Whether a program is on the PATH.
pub fn has(program: &str) -> bool {
    std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())
        .any(|folder| folder.join(program).is_file())
}

/// Creates a folder, or empties it if it exists.
pub fn empty(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder)?;
    }
    fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))
}

/// Whether this process is root, so that it may install packages by itself.
pub fn is_root() -> bool {
    Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|out| out.stdout == b"0\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program built with the flags names no folder of this machine; one built without them does.
    #[test]
    fn what_is_handed_out_names_no_folder_of_this_machine() {
        let workspace = root().canonicalize().unwrap();
        let folder = target().join(format!("paths-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let source = workspace
            .join("target")
            .join(format!("paths-{}.rs", std::process::id()));
        fs::write(
            &source,
            "fn main() { println!(\"{}\", std::panic::Location::caller().file()) }",
        )
        .unwrap();
        let build = |flags: &str, name: &str| {
            let built = folder.join(name);
            let mut rustc = Command::new("rustc");
            rustc.args(
                flags
                    .split('\x1f')
                    .filter(|flag| flag.starts_with("--remap")),
            );
            let status = rustc
                .args(["-C", "strip=symbols", "--edition=2024"])
                .arg(&source)
                .arg("-o")
                .arg(&built);
            assert!(status.status().unwrap().success());
            built
        };
        let plain = build("", "plain");
        assert!(named_folder(&plain).unwrap().is_some());
        assert!(check_names_no_folder(&plain).is_err());
        let mapped = build(&release_flags(), "mapped");
        assert_eq!(named_folder(&mapped).unwrap(), None);
        fs::remove_file(source).unwrap();
        fs::remove_dir_all(folder).unwrap();
    }
}
