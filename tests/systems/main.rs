//! Checks that a system consists only of its file or folder and its lines in the registry. Without
//! them the rest compiles. A new system appears in the command and the C interface without any
//! other change.
//!
//! Both tests work in a copy of the tree, which shares the compiled dependencies of this build. The
//! library with the toy system stays in the build's folder, where the tests of the extension find
//! it.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyface::{mesh::Mesh, output::read_vertex_motion};
use anyface_tests::{
    native::{name_by_interface, profile_dir, root, succeed},
    scene::Scene,
};

const REGISTRY: &str = "rust-core/src/systems/mod.rs";

/// A copy of the crates that users get, in a folder of the build: a workspace with the crates in a
/// folder below it.
///
/// Cargo names the files of a build after the place of the crate in its workspace. In the same
/// place as ours, the two builds would overwrite each other, and both would be compiled again.
struct Tree {
    workspace: PathBuf,
    crates: PathBuf,
}

impl Tree {
    fn copied(name: &str) -> Tree {
        let folder = profile_dir().join("trees").join(name);
        if folder.exists() {
            fs::remove_dir_all(&folder).unwrap();
        }
        let crates = folder.join(name);
        for part in ["rust-core", "cli", "capi", "microphone", "include"] {
            copy(&root().join(part), &crates.join(part));
        }
        fs::copy(root().join("Cargo.lock"), folder.join("Cargo.lock")).unwrap();
        let text = fs::read_to_string(root().join("Cargo.toml")).unwrap();
        let members = text
            .lines()
            .find(|line| line.starts_with("members"))
            .unwrap();
        let text = text.replace(
            members,
            &format!("members = [\"{name}/*\"]\nexclude = [\"{name}/include\"]"),
        );
        let parts = ["rust-core", "microphone"];
        let text = parts.iter().fold(text, |text, part| {
            text.replace(
                &format!("path = \"{part}\""),
                &format!("path = \"{name}/{part}\""),
            )
        });
        let weights = format!("path = \"{}/weights/", root().display());
        let text = text.replace("path = \"weights/", &weights);
        fs::write(folder.join("Cargo.toml"), text).unwrap();
        Tree {
            workspace: folder,
            crates,
        }
    }

    /// Replaces a text that must be in a file.
    fn edit(&self, file: &str, from: &str, to: &str) {
        let path = self.crates.join(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{file} holds no {from:?}");
        fs::write(&path, text.replace(from, to)).unwrap();
    }

    fn cargo(&self, arguments: &[&str]) {
        let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        command
            .current_dir(&self.workspace)
            .args(arguments)
            .arg("--offline")
            // Optimising the library takes minutes, and the toy moves only one small mesh.
            .args(["--config", "profile.dev.package.anyface.opt-level=0"]);
        let build = profile_dir();
        succeed(command.arg("--target-dir").arg(build.parent().unwrap()));
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let (path, target) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &target)
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

#[test]
fn without_its_folder_and_its_lines_of_the_registry_the_rest_compiles() {
    let systems = fs::read_dir(root().join("rust-core/src/systems")).unwrap();
    let names: Vec<String> = systems
        .flatten()
        .filter(|entry| entry.path().is_dir())
        .map(|entry| entry.file_name().into_string().unwrap())
        .collect();
    assert!(names.contains(&"freetalk".to_owned()), "{names:?}");
    for name in names {
        let tree = Tree::copied("without");
        fs::remove_dir_all(tree.crates.join("rust-core/src/systems").join(&name)).unwrap();
        let feature = format!("#[cfg(feature = \"{}\")]\n", name.replace('_', "-"));
        let registry = fs::read_to_string(root().join(REGISTRY)).unwrap();
        let ending = format!(" mod {name};");
        let line = registry.lines().find(|line| line.ends_with(&ending));
        tree.edit(REGISTRY, &format!("{feature}{}\n", line.unwrap()), "");
        let entry = format!("    {feature}    &{name}::REGISTRATION,\n");
        tree.edit(REGISTRY, &entry, "");
        tree.cargo(&["check", "--workspace"]);
    }
}

#[test]
fn a_toy_of_a_file_and_two_words_moves_a_mesh_through_the_command_and_c() {
    let tree = Tree::copied("toy");
    let toy = fs::read_to_string(root().join("tests/systems/toy.rs")).unwrap();
    assert!(toy.lines().count() <= 100);
    fs::write(tree.crates.join("rust-core/src/systems/toy.rs"), toy).unwrap();
    tree.edit(
        REGISTRY,
        "pub(crate) mod freetalk;\n",
        "pub(crate) mod freetalk;\npub(crate) mod toy;\n",
    );
    tree.edit(
        REGISTRY,
        "&freetalk::REGISTRATION",
        "&freetalk::REGISTRATION, &toy::REGISTRATION",
    );
    // Rename the library and the command, so that they do not replace those of this build.
    tree.edit(
        "capi/Cargo.toml",
        "name = \"anyface\"\n",
        "name = \"anyface_toy\"\n",
    );
    tree.edit(
        "cli/Cargo.toml",
        "[[bin]]\nname = \"anyface\"",
        "[[bin]]\nname = \"anyface-toy\"",
    );
    tree.cargo(&["build", "--workspace"]);
    let folder = tree.workspace.join("run");
    let scene = Scene::write(&folder, 1.0).unwrap();
    let clip = folder.join("toy.npz");
    let mut command = Command::new(profile_dir().join("anyface-toy"));
    command.args(["animate", "--system", "toy", "--drop", "20", "--no-cache"]);
    command
        .arg("--mesh")
        .arg(&scene.head)
        .arg("--landmarks")
        .arg(&scene.landmarks);
    succeed(
        command
            .arg("--audio")
            .arg(&scene.voice)
            .arg("--out")
            .arg(&clip),
    );
    let by_command = largest(&clip, &scene);
    assert!(
        (10.0..25.0).contains(&(10.0 * by_command)),
        "{by_command} cm"
    );
    let by_c = through_c(&folder, &scene);
    assert!(
        (by_c - by_command).abs() < 1e-5 * by_command,
        "{by_c} and {by_command}"
    );
}

/// Length of the longest displacement of a clip, units of the mesh.
fn largest(clip: &Path, scene: &Scene) -> f32 {
    let moved = read_vertex_motion(clip, &Mesh::read(&scene.head).unwrap()).unwrap();
    let rows = moved.displacements.rows().into_iter();
    rows.map(|d| d.dot(&d)).fold(0.0f32, f32::max).sqrt()
}

/// The same length from a C program that knows nothing of the system but its name.
fn through_c(folder: &Path, scene: &Scene) -> f32 {
    let program = folder.join("toy");
    let libraries = profile_dir();
    let mut compiler = Command::new(env::var_os("CC").unwrap_or_else(|| "gcc".into()));
    compiler
        .args(["-std=c11", "-Wall", "-Werror"])
        .arg("-I")
        .arg(root().join("include"));
    compiler
        .arg(root().join("tests/systems/toy.c"))
        .arg("-o")
        .arg(&program);
    compiler.arg("-L").arg(&libraries).arg("-lanyface_toy");
    succeed(&mut compiler);
    // Make the link in a separate folder: this build's library has the same interface version.
    name_by_interface(&libraries.join("libanyface_toy.so"), folder);
    let mut command = Command::new(program);
    command.env("LD_LIBRARY_PATH", folder);
    command
        .arg(&scene.head)
        .arg(&scene.landmarks)
        .arg(&scene.voice);
    let output = succeed(&mut command);
    String::from_utf8(output.stdout)
        .unwrap()
        .trim()
        .parse()
        .unwrap()
}
