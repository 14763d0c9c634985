//! Installs the C library as a tree that pkg-config and CMake can use: `lib`, `include`, package
//! files and licences.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::{licences, machine, platform::Platform};

/// Version of all crates of the workspace, including this one.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The system libraries that the static library needs, as `rustc --print native-static-libs` lists
/// them.
fn system_libraries(platform: Platform) -> &'static [&'static str] {
    match platform {
        // Also gcc_s, but compilers link it by themselves, statically if asked to.
        Platform::LinuxX64 | Platform::LinuxArm64 => &["util", "rt", "pthread", "m", "dl", "c"],
        Platform::MacosArm64 | Platform::MacosX64 => &["iconv", "System", "c", "m"],
        Platform::WindowsX64 => &["kernel32", "ntdll", "userenv", "ws2_32", "dbghelp"],
    }
}

/// Installs the C library under a prefix: lib, include, pkg-config and CMake package files, licences.
#[derive(Args)]
pub struct Install {
    /// The folder that receives `lib`, `include` and `share/doc/anyface`, such as /usr/local.
    #[arg(long)]
    prefix: PathBuf,
    /// Folder of a built libanyface.so and libanyface.a; without it a release build is made.
    #[arg(long)]
    library_dir: Option<PathBuf>,
}

impl Install {
    /// Builds the library unless a folder is given, then copies everything.
    pub fn run(&self) -> Result<()> {
        let built = match &self.library_dir {
            Some(folder) => folder.clone(),
            None => build()?,
        };
        install(Platform::here()?, &built, &self.prefix)?;
        licences::copy(&self.prefix.join("share/doc/anyface"))?;
        println!("installed into {}", self.prefix.display());
        Ok(())
    }
}

fn build() -> Result<PathBuf> {
    let status = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(["build", "--release", "--package", "anyface-capi"])
        .env("CARGO_ENCODED_RUSTFLAGS", machine::release_flags())
        .current_dir(machine::root())
        .status()
        .context("starting cargo")?;
    ensure!(status.success(), "building the library failed");
    Ok(machine::target().join("release"))
}

/// Copies the libraries of `built`, the header and the package files below `prefix`.
///
/// # Errors
/// If a library is missing or the prefix cannot be written.
pub fn install(platform: Platform, built: &Path, prefix: &Path) -> Result<()> {
    let root = machine::root();
    let (lib, include) = (prefix.join("lib"), prefix.join("include"));
    let shared = platform.shared_library();
    let soname = soname(platform)?;
    copy(&built.join(shared), &lib.join(&soname))?;
    link(&soname, &lib.join(shared))?;
    let library = platform.static_library();
    copy(&built.join(library), &lib.join(library))?;
    if platform == Platform::WindowsX64 {
        let name = "anyface.dll.lib";
        copy(&built.join(name), &lib.join(name))?;
    }
    copy(&root.join("include/anyface.h"), &include.join("anyface.h"))?;
    let templates = root.join("packaging");
    for (template, place, separator) in [
        (
            "pkg-config/anyface.pc.in",
            "pkgconfig/anyface.pc",
            Separator::Flags,
        ),
        (
            "pkg-config/anyface-static.pc.in",
            "pkgconfig/anyface-static.pc",
            Separator::Flags,
        ),
        (
            "cmake/anyface-config.cmake.in",
            "cmake/anyface/anyface-config.cmake",
            Separator::List,
        ),
        (
            "cmake/anyface-config-version.cmake.in",
            "cmake/anyface/anyface-config-version.cmake",
            Separator::List,
        ),
    ] {
        let text = fs::read_to_string(templates.join(template))
            .with_context(|| format!("reading packaging/{template}"))?;
        write(&lib.join(place), &fill(&text, separator, platform, &soname))?;
    }
    Ok(())
}

/// How a package file lists libraries.
#[derive(Clone, Copy)]
enum Separator {
    /// `-lm -lc`
    Flags,
    /// `m;c`
    List,
}

/// The name under which programs look for the shared library. On Linux it ends with the version of
/// the library's interface.
///
/// # Errors
/// If the header cannot be read or does not state the version.
fn soname(platform: Platform) -> Result<String> {
    let library = platform.shared_library();
    if !platform.is_linux() {
        return Ok(library.to_owned());
    }
    let header = fs::read_to_string(machine::root().join("include/anyface.h"))?;
    let mut lines = header.lines();
    let version = lines.find_map(|line| line.strip_prefix("#define ANYFACE_ABI_VERSION "));
    let version = version.context("include/anyface.h does not state ANYFACE_ABI_VERSION")?;
    Ok(format!("{library}.{version}"))
}

/// Makes `place` a symbolic link to the library, unless that is the library's own name.
fn link(soname: &str, place: &Path) -> Result<()> {
    if place.file_name().is_some_and(|name| name == soname) {
        return Ok(());
    }
    if place.symlink_metadata().is_ok() {
        fs::remove_file(place).with_context(|| format!("replacing {}", place.display()))?;
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink(soname, place)
        .with_context(|| format!("making {}", place.display()))?;
    Ok(())
}

fn fill(template: &str, separator: Separator, platform: Platform, soname: &str) -> String {
    let needed = system_libraries(platform);
    let libraries = match separator {
        Separator::Flags => format!("-l{}", needed.join(" -l")),
        Separator::List => needed.join(";"),
    };
    let soname_property = if soname == platform.shared_library() {
        "IMPORTED_NO_SONAME TRUE".to_owned()
    } else {
        format!("IMPORTED_SONAME {soname}")
    };
    let mut parts = VERSION.split('.');
    let (major, minor) = (parts.next().unwrap_or("0"), parts.next().unwrap_or("0"));
    template
        .replace("@VERSION@", VERSION)
        .replace("@MAJOR@", major)
        .replace("@MINOR@", minor)
        .replace("@SHARED_LIBRARY@", platform.shared_library())
        .replace("@STATIC_LIBRARY@", platform.static_library())
        .replace("@SONAME@", &soname_property)
        .replace("@SYSTEM_LIBRARIES@", &libraries)
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    make_folder(to)?;
    fs::copy(from, to)
        .with_context(|| format!("copying {} to {}", from.display(), to.display()))?;
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<()> {
    make_folder(path)?;
    fs::write(path, text).with_context(|| format!("writing {}", path.display()))
}

fn make_folder(file: &Path) -> Result<()> {
    let folder = file.parent().context("a file lies in a folder")?;
    fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_placeholder_stays() {
        for template in [
            "pkg-config/anyface.pc.in",
            "cmake/anyface-config.cmake.in",
            "cmake/anyface-config-version.cmake.in",
        ] {
            let path = machine::root().join("packaging").join(template);
            let text = fs::read_to_string(path).unwrap();
            for separator in [Separator::Flags, Separator::List] {
                let filled = fill(&text, separator, Platform::LinuxX64, "libanyface.so.1");
                assert!(!filled.contains('@'), "{template}: {filled}");
            }
        }
    }

    #[test]
    fn a_library_that_was_not_built_is_named() {
        let prefix = std::env::temp_dir().join(format!("anyface-install-{}", std::process::id()));
        let error = install(Platform::LinuxX64, Path::new("/nowhere"), &prefix)
            .unwrap_err()
            .to_string();
        assert!(error.contains("anyface"), "{error}");
        fs::remove_dir_all(prefix).unwrap();
    }
}
