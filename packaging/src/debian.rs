//! Packs the C library as a Debian package, and checks that it installs and that C programs find
//! it.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result};

use crate::{install, licences, machine, platform::Platform, steps::Steps};

const NAME: &str = "libanyface-dev";
const PROGRAM: &str = "#include <anyface.h>\n\
     int main(void) { return anyface_abi_version() != ANYFACE_ABI_VERSION; }\n";

/// Packs the libraries in `built` and returns the path of the package, which lies in `out`.
pub fn build(steps: &mut Steps, platform: Platform, built: &Path, out: &Path) -> Result<PathBuf> {
    let tree = machine::target().join("debian");
    let package = stage(platform, built, &tree, out)?;
    let mut pack = Command::new("dpkg-deb");
    pack.args(["--root-owner-group", "--build"])
        .arg(&tree)
        .arg(&package);
    steps.run("pack the Debian package", &mut pack)?;
    Ok(package)
}

/// Lays out the files of the package in `tree`. Returns the path for the package.
fn stage(platform: Platform, built: &Path, tree: &Path, out: &Path) -> Result<PathBuf> {
    let version = env!("CARGO_PKG_VERSION");
    machine::empty(tree)?;
    install::install(platform, built, &tree.join("usr"))?;
    let documents = tree.join("usr/share/doc").join(NAME);
    fs::create_dir_all(&documents)?;
    fs::write(documents.join("copyright"), copyright()?)?;
    fs::create_dir_all(tree.join("DEBIAN"))?;
    let size = size_kb(&tree.join("usr"))?;
    let processor = match platform {
        Platform::LinuxArm64 => "arm64",
        _ => "amd64",
    };
    fs::write(
        tree.join("DEBIAN/control"),
        control(version, processor, size),
    )?;
    Ok(out.join(format!("{NAME}_{version}_{processor}.deb")))
}

/// All licences in one text, because Debian looks for them in one file.
fn copyright() -> Result<String> {
    let texts = licences::FILES.iter().map(|name| {
        let text = fs::read_to_string(machine::root().join(name));
        text.with_context(|| format!("reading {name}"))
    });
    Ok(texts.collect::<Result<Vec<_>>>()?.join("\n\n"))
}

fn control(version: &str, processor: &str, size_kb: u64) -> String {
    format!(
        "Package: {NAME}\nVersion: {version}\nArchitecture: {processor}\nSection: libdevel\n\
         Priority: optional\nMaintainer: {} <anyface@localhost>\nInstalled-Size: {size_kb}\n\
         Depends: libc6 (>= 2.28)\nDescription: {}\n The library, shared and static, with its \
         weights, the C header, and the files of\n pkg-config and CMake.\n",
        env!("CARGO_PKG_AUTHORS"),
        "makes any face mesh talk (C library)"
    )
}

fn size_kb(folder: &Path) -> Result<u64> {
    let mut sum = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        sum += if entry.file_type()?.is_dir() {
            size_kb(&entry.path())?
        } else {
            entry.metadata()?.len().div_ceil(1024)
        };
    }
    Ok(sum)
}

/// Installs `package` into a folder of its own with dpkg, compiles a C program against it and runs
/// it.
pub fn check(steps: &mut Steps, package: &Path) -> Result<()> {
    let root = machine::target().join("debian-root");
    machine::empty(&root)?;
    for command in &mut check_commands(package, &root)? {
        let name = command.get_program().to_string_lossy().into_owned();
        steps.run(&format!("try the Debian package ({name})"), command)?;
    }
    fs::remove_dir_all(root)?;
    Ok(())
}

fn check_commands(package: &Path, root: &Path) -> Result<Vec<Command>> {
    let database = root.join("var/lib/dpkg");
    fs::create_dir_all(database.join("info"))?;
    fs::create_dir_all(database.join("updates"))?;
    fs::write(database.join("status"), "")?;
    let source = root.join("version.c");
    fs::write(&source, PROGRAM)?;
    let mut dpkg = Command::new("dpkg");
    // The folder holds no system, so dpkg does not find libc6 there; programs use the machine's.
    dpkg.args(["--force-depends", "--force-not-root", "--log=/dev/null"]);
    dpkg.arg(format!("--root={}", root.display()))
        .arg("--install")
        .arg(package);
    let mut compile = Command::new("sh");
    compile.current_dir(root).args([
        "-e",
        "-c",
        "cc version.c -o version $(pkg-config --cflags --libs anyface)",
    ]);
    compile.env("PKG_CONFIG_PATH", root.join("usr/lib/pkgconfig"));
    let mut run = Command::new(root.join("version"));
    run.env("LD_LIBRARY_PATH", root.join("usr/lib"));
    Ok(vec![dpkg, compile, run])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Builds libraries with only the one function that the program calls.
    fn stand_in(folder: &Path) {
        let stub = "unsigned anyface_abi_version(void) { return 1; }\n";
        fs::write(folder.join("stub.c"), stub).unwrap();
        for words in [
            "cc -shared -fPIC stub.c -o libanyface.so",
            "cc -c stub.c -o stub.o && ar rcs libanyface.a stub.o",
        ] {
            let status = Command::new("sh")
                .current_dir(folder)
                .args(["-c", words])
                .status();
            assert!(status.unwrap().success());
        }
    }

    #[test]
    #[cfg_attr(
        not(all(has_dpkg_deb, has_pkg_config)),
        ignore = "needs dpkg-deb and pkg-config"
    )]
    fn a_package_installs_and_a_c_program_compiles_against_it() {
        let folder = std::env::temp_dir().join(format!("anyface-deb-{}", std::process::id()));
        let (built, tree, root) = (
            folder.join("built"),
            folder.join("tree"),
            folder.join("root"),
        );
        fs::create_dir_all(&built).unwrap();
        stand_in(&built);
        let package = stage(Platform::here().unwrap(), &built, &tree, &folder).unwrap();
        let mut pack = Command::new("dpkg-deb");
        pack.args(["--root-owner-group", "--build"])
            .arg(&tree)
            .arg(&package);
        let mut commands = vec![pack];
        commands.extend(check_commands(&package, &root).unwrap());
        for mut command in commands {
            let output = command.output().unwrap();
            assert!(output.status.success(), "{command:?}: {output:?}");
        }
        let installed = root.join("usr/share/doc").join(NAME).join("copyright");
        let text = fs::read_to_string(installed).unwrap();
        for name in licences::FILES {
            let part = fs::read_to_string(machine::root().join(name)).unwrap();
            assert!(text.contains(&part), "{name}");
        }
        fs::remove_dir_all(folder).unwrap();
    }
}
