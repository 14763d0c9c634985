//! Installs the library and finds it the way a host's build does.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyface_tests::native::{command, library_dir, profile_dir, root, run, succeed};

use crate::workspace;

/// Installs into a folder, moves it and returns the new path, so that a reference to the old one
/// fails.
fn installed(folder: &Path) -> PathBuf {
    let (first, moved) = (folder.join("first"), folder.join("moved"));
    let mut command = Command::new(profile_dir().join("xtask"));
    command
        .current_dir(root())
        .arg("install")
        .arg("--library-dir")
        .arg(library_dir());
    succeed(command.arg("--prefix").arg(&first));
    std::fs::rename(first, &moved).expect("the tree can be moved");
    moved
}

/// Writes a program of one line that needs the header and the library.
fn write_program(folder: &Path) {
    let source = "#include <anyface.h>\n\
                  int main(void) { return anyface_abi_version() != ANYFACE_ABI_VERSION; }\n";
    std::fs::write(folder.join("version.c"), source).expect("the source can be written");
}

#[test]
#[cfg_attr(not(has_pkg_config), ignore = "needs pkg-config")]
fn pkg_config_finds_the_installed_library() {
    let folder = workspace("pkg-config");
    let prefix = installed(&folder);
    write_program(&folder);
    for (package, program) in [("anyface", "shared"), ("anyface-static", "static")] {
        let mut ask = Command::new("pkg-config");
        ask.env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"));
        ask.args(["--cflags", "--libs", package]);
        let flags = String::from_utf8(succeed(&mut ask).stdout).expect("pkg-config prints text");
        let mut compile = Command::new("gcc");
        compile
            .current_dir(&folder)
            .args(["version.c", "-o", program]);
        succeed(compile.args(flags.split_whitespace()));
        let mut started = command(folder.join(program));
        if program == "shared" {
            started.env("LD_LIBRARY_PATH", prefix.join("lib"));
        }
        succeed(&mut started);
    }
}

#[test]
fn licences_are_installed_with_the_library() {
    let folder = workspace("licences");
    let documents = installed(&folder).join("share/doc/anyface");
    for name in ["LICENSE-MIT", "LICENSE-APACHE", "NOTICE", "THIRD-PARTY.md"] {
        let text = |folder: &Path| std::fs::read_to_string(folder.join(name)).expect(name);
        assert_eq!(text(&documents), text(root()), "{name}");
    }
}

#[test]
#[cfg_attr(not(has_pkg_config), ignore = "needs pkg-config")]
fn pkg_config_static_makes_a_program_without_shared_libraries() {
    let folder = workspace("static");
    let prefix = installed(&folder);
    let source = "#include <anyface.h>\n\
                  int main(void) {\n\
                  AnyfaceEngine *engine = NULL;\n\
                  return anyface_engine_new(NULL, &engine, NULL) != ANYFACE_STATUS_OK;\n}\n";
    std::fs::write(folder.join("engine.c"), source).expect("the source can be written");
    let mut ask = Command::new("pkg-config");
    ask.env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"));
    ask.args(["--static", "--cflags", "--libs", "anyface"]);
    let flags = String::from_utf8(succeed(&mut ask).stdout).expect("pkg-config prints text");
    let mut compile = Command::new("gcc");
    compile.current_dir(&folder);
    compile.args(["-static", "engine.c", "-o", "engine"]);
    succeed(compile.args(flags.split_whitespace()));
    succeed(&mut command(folder.join("engine")));
    let listed = Command::new("readelf")
        .args(["-d", "engine"])
        .current_dir(&folder)
        .output();
    let listed = String::from_utf8_lossy(&listed.expect("binutils are there").stdout).into_owned();
    assert!(!listed.contains("NEEDED"), "{listed}");
}

#[test]
#[cfg_attr(not(has_pkg_config), ignore = "needs pkg-config")]
fn a_program_looks_for_the_interface_that_it_was_linked_to() {
    let folder = workspace("soname");
    let prefix = installed(&folder);
    write_program(&folder);
    let lib = prefix.join("lib");
    let mut compile = Command::new("gcc");
    compile
        .current_dir(&folder)
        .args(["version.c", "-o", "version"]);
    compile
        .arg("-I")
        .arg(prefix.join("include"))
        .arg("-L")
        .arg(&lib)
        .arg("-lanyface");
    succeed(&mut compile);
    let mut started = command(folder.join("version"));
    started.env("LD_LIBRARY_PATH", &lib);
    succeed(&mut started);
    // Another version of the interface has another file name, and the program must not load it.
    let target = std::fs::read_link(lib.join("libanyface.so")).expect("a link");
    std::fs::rename(lib.join(&target), lib.join("libanyface.so.99")).expect("it can be moved");
    assert!(!started.output().expect("it starts").status.success());
}

const PROJECT: &str = "cmake_minimum_required(VERSION 3.16)
project(host C)
find_package(anyface 0.1 REQUIRED)
add_executable(shared version.c)
target_link_libraries(shared PRIVATE anyface::anyface)
add_executable(static version.c)
target_link_libraries(static PRIVATE anyface::static)
";

#[test]
#[cfg_attr(not(has_cmake), ignore = "needs cmake")]
fn cmake_finds_the_installed_library() {
    let folder = workspace("cmake");
    let prefix = installed(&folder);
    write_program(&folder);
    std::fs::write(folder.join("CMakeLists.txt"), PROJECT).expect("the project can be written");
    let mut configure = Command::new("cmake");
    configure
        .current_dir(&folder)
        .args(["-S", ".", "-B", "build"]);
    configure.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display()));
    succeed(&mut configure);
    succeed(
        Command::new("cmake")
            .current_dir(&folder)
            .args(["--build", "build"]),
    );
    for program in ["shared", "static"] {
        succeed(&mut command(folder.join("build").join(program)));
    }
    // A host that asks for another minor version is refused.
    let newer = PROJECT.replace("anyface 0.1", "anyface 0.2");
    std::fs::write(folder.join("CMakeLists.txt"), newer).expect("the project can be written");
    run(&mut configure, 1);
}
