//! Builds the C library once, compiles C and C++ programs against it and runs them.

use std::{
    env,
    ffi::{OsStr, OsString},
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::OnceLock,
};

/// Libraries that a program needs besides the static library, on Linux with glibc.
const SYSTEM_LIBRARIES: &[&str] = &["-lutil", "-lrt", "-lpthread", "-lm", "-ldl", "-lc"];

/// Root folder of the workspace.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Which library a program links.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Linkage {
    /// libanyface.so
    Shared,
    /// libanyface.a
    Static,
}

/// Folder that holds `libanyface.so` and `libanyface.a`.
///
/// `ANYFACE_LIBRARY_DIR` may name the folder of a library built elsewhere, to test that one.
/// Otherwise cargo builds both libraries once for this process, with the profile and the features
/// of the running tests, so that nothing else is recompiled.
pub fn library_dir() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| match env::var_os("ANYFACE_LIBRARY_DIR") {
        Some(folder) => folder.into(),
        None => {
            build();
            let folder = profile_dir();
            name_by_interface(Path::new("libanyface.so"), &folder);
            folder
        }
    })
}

/// Makes a link in `folder` to a shared library, named by the version of its interface. Programs
/// look for the library under this name, but cargo does not give it.
pub fn name_by_interface(library: &Path, folder: &Path) {
    let header = std::fs::read_to_string(root().join("include/anyface.h")).expect("the header");
    let mut lines = header.lines();
    let version = lines.find_map(|line| line.strip_prefix("#define ANYFACE_ABI_VERSION "));
    let name = format!(
        "libanyface.so.{}",
        version.expect("the header states its version")
    );
    // Another test process may have made the link already.
    #[cfg(unix)]
    if std::os::unix::fs::symlink(library, folder.join(&name)).is_err() {
        assert!(folder.join(&name).exists(), "{name} cannot be made");
    }
}

/// The folder of the build profile, such as `target/debug`. Tests run in its folder `deps`.
pub fn profile_dir() -> PathBuf {
    let test = env::current_exe().expect("the test knows its own path");
    let folder = test
        .ancestors()
        .nth(2)
        .expect("a test runs in <profile>/deps");
    folder.to_owned()
}

fn build() {
    let folder = profile_dir();
    let profile = match folder.file_name().and_then(|name| name.to_str()) {
        Some("debug") | None => "dev",
        Some(name) => name,
    };
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args([
        "build",
        "--workspace",
        "--lib",
        "--bins",
        "--tests",
        "--profile",
        profile,
    ]);
    command
        .arg("--target-dir")
        .arg(folder.parent().expect("<target>/<profile>"));
    succeed(command.current_dir(root()));
}

/// Compiles one source against the library, with warnings as errors, and returns the program.
///
/// `source`: path within the workspace, or absolute; its ending decides between C11 and C++17. The
/// program lies in `folder` and is named after source and linkage.
pub fn compile(source: &str, linkage: Linkage, folder: &Path) -> PathBuf {
    std::fs::create_dir_all(folder).expect("the folder for programs can be written");
    let name = Path::new(source).file_name().expect("a source has a name");
    let program = folder.join(format!("{}.{linkage:?}", name.to_string_lossy()));
    let (compiler, standard) = if source.ends_with(".cpp") {
        (
            env::var_os("CXX").unwrap_or_else(|| "g++".into()),
            "-std=c++17",
        )
    } else {
        (
            env::var_os("CC").unwrap_or_else(|| "gcc".into()),
            "-std=c11",
        )
    };
    let mut command = Command::new(compiler);
    command.args([
        standard,
        "-g",
        "-O1",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-pedantic",
        "-pthread",
    ]);
    command.arg("-I").arg(root().join("include"));
    command.arg(root().join(source)).arg("-o").arg(&program);
    command.args(link_arguments(linkage));
    succeed(&mut command);
    program
}

fn link_arguments(linkage: Linkage) -> Vec<OsString> {
    let folder = library_dir();
    match linkage {
        Linkage::Shared => {
            let mut search: OsString = "-Wl,-rpath,".into();
            search.push(folder);
            vec!["-L".into(), folder.into(), search, "-lanyface".into()]
        }
        Linkage::Static => {
            let mut arguments = vec![folder.join("libanyface.a").into()];
            arguments.extend(SYSTEM_LIBRARIES.iter().map(OsString::from));
            arguments
        }
    }
}

/// A command that has to find libraries by itself. It does not inherit cargo's search path for
/// tests, which leads to the library of this build, whichever one was linked.
pub fn command(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(program);
    command.env_remove("LD_LIBRARY_PATH");
    command
}

/// Runs a command that must end with exit code 0.
pub fn succeed(command: &mut Command) -> Output {
    run(command, 0)
}

/// Runs a command that must end with this exit code.
///
/// # Panics
/// If the command cannot start or ends with another exit code. The message holds what it printed.
pub fn run(command: &mut Command, expected: i32) -> Output {
    let output = command
        .output()
        .unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(
        output.status.code() == Some(expected),
        "{command:?}\nexpected exit code {expected}, got {}\n{}\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}
