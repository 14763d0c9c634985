//! Tests every promise of the header from C.

use std::{path::Path, process::Command};

use anyface_tests::native::{Linkage, command, compile, library_dir, succeed};

use crate::{scene, workspace};

/// Runs one of the C test programs of this folder, linked to the shared and to the static library.
fn run_both_ways(source: &str, arguments: impl Fn(&Path) -> Vec<String>) {
    for linkage in [Linkage::Shared, Linkage::Static] {
        let stem = source.rsplit('/').next().unwrap_or(source);
        let folder = workspace(&format!("{stem} {linkage:?}"));
        let program = compile(source, linkage, &folder);
        let mut command = command(program);
        command
            .args(arguments(&folder))
            .env("XDG_CACHE_HOME", folder.join("cache"));
        let output = succeed(&mut command);
        assert_eq!(output.stdout, b"ok\n");
        assert!(output.stderr.is_empty(), "the library printed: {output:?}");
    }
}

fn text(path: &Path) -> String {
    path.to_str()
        .expect("the target folder's name is UTF-8")
        .to_owned()
}

#[test]
fn wrong_calls_give_their_status_and_write_nothing() {
    run_both_ways("tests/c_host/errors.c", |folder| vec![text(folder)]);
}

#[test]
fn jobs_on_one_engine_do_not_disturb_each_other() {
    run_both_ways("tests/c_host/jobs.c", |folder| {
        let scene = scene(folder);
        [scene.head, scene.landmarks, scene.voice]
            .iter()
            .map(|path| text(path))
            .collect()
    });
}

#[test]
fn threads_with_little_stack_do_the_whole_way() {
    run_both_ways("tests/c_host/small_stack.c", |folder| {
        let scene = scene(folder);
        vec![text(&scene.head), text(&scene.voice)]
    });
}

#[test]
fn sliders_of_a_take_say_what_they_change() {
    run_both_ways("tests/c_host/sliders.c", |folder| {
        let scene = scene(folder);
        [scene.head, scene.landmarks, scene.voice]
            .iter()
            .map(|path| text(path))
            .collect()
    });
}

#[test]
fn head_and_eyes_come_beside_a_motion() {
    run_both_ways("tests/c_host/life.c", |folder| {
        vec![text(&scene(folder).voice), text(&folder.join("motion.npz"))]
    });
}

#[test]
fn calls_in_any_order_neither_crash_nor_keep_memory() {
    run_both_ways("tests/c_host/soak.c", |folder| {
        let scene = scene(folder);
        let files = [scene.head, scene.landmarks, scene.voice];
        let mut arguments: Vec<String> = files.iter().map(|path| text(path)).collect();
        arguments.extend(["900", "7"].map(str::to_owned));
        arguments
    });
}

#[test]
fn a_stream_gives_the_same_bits_however_the_sound_is_cut() {
    run_both_ways("tests/c_host/stream.c", |folder| {
        vec![text(&scene(folder).voice)]
    });
}

#[test]
fn the_shared_library_exports_the_interface_and_nothing_else() {
    let library = library_dir().join("libanyface.so");
    let output = succeed(
        Command::new("nm")
            .args(["-D", "--defined-only"])
            .arg(library),
    );
    let listing = String::from_utf8(output.stdout).expect("nm prints text");
    let symbols: Vec<&str> = listing
        .lines()
        .filter_map(|line| line.rsplit(' ').next())
        .collect();
    assert!(symbols.contains(&"anyface_engine_animate"), "{symbols:?}");
    let foreign: Vec<_> = symbols
        .iter()
        .filter(|name| !name.starts_with("anyface_"))
        .collect();
    assert!(foreign.is_empty(), "{foreign:?}");
}
