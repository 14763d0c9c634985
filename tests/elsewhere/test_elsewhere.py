"""Runs the command and the library of another system here and compares them with this machine's.

`ANYFACE_RUNNER` holds the words that run a program of the other system, such as those of Wine or
QEMU. `ANYFACE_BUILT` is the folder with that system's command and library. Without these two the
tests are ignored. `ANYFACE_COMMAND` is the command of this machine.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import wave
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import RATE_HZ, ROOT, write_wav

SHARED = Path(os.environ.get("ANYFACE_SHARED", ROOT / "../shared"))
HEAD = ROOT / "weights/shared/default_head"
HEADER = ROOT / "include/anyface.h"
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
RUNNER, BUILT = os.environ.get("ANYFACE_RUNNER", "").split(), os.environ.get("ANYFACE_BUILT", "")
IS_WINDOWS = Path(BUILT, "anyface.exe").is_file()
PROGRAM = "anyface.exe" if IS_WINDOWS else "anyface"
LIBRARY = "anyface.dll" if IS_WINDOWS else "libanyface.so"
COMPILER = "x86_64-w64-mingw32-gcc" if IS_WINDOWS else "aarch64-linux-gnu-gcc"
# Tolerance in metres: another C library rounds sines and exponentials differently.
NEAR_M = 1e-5

pytestmark = pytest.mark.skipif(
    not (RUNNER and BUILT), reason="ignored, needs ANYFACE_RUNNER and ANYFACE_BUILT"
)
on_windows = pytest.mark.skipif(not IS_WINDOWS, reason="ignored, it is about Windows alone")


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """A temporary folder with the command, the library and a head. Wine may see no other files."""
    folder = tmp_path_factory.mktemp("programs")
    for name in (PROGRAM, LIBRARY):
        shutil.copy(f"{BUILT}/{name}", folder)
    shutil.copy(HEAD / "head.obj", folder)
    return folder


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    """The environment for programs of the other system. Those for Windows get a new Wine prefix."""
    folder = tmp_path_factory.mktemp("system")
    hidden = {"DISPLAY", "ANYFACE_CACHE"}
    inherited = {name: value for name, value in os.environ.items() if name not in hidden}
    environment = {**inherited, "LANG": "C.UTF-8", "XDG_CACHE_HOME": str(folder / "cache")}
    if IS_WINDOWS:
        environment |= {"WINEPREFIX": str(folder), "WINEDEBUG": "-all", "XDG_RUNTIME_DIR": "/tmp"}
        run([*RUNNER, "wineboot", "--init"], environment)
    return environment


def run(words, environment=None, code=0):
    """Runs a program and asserts its exit code; returns the finished process."""
    done = subprocess.run(
        words, env=environment, capture_output=True, text=True, encoding="utf-8", errors="replace",
        check=False,
    )  # fmt: skip
    assert done.returncode == code, f"{done.returncode}: {done.stdout}{done.stderr}"
    return done


def named(path):
    """The name that the other system has for a file of this machine."""
    return "Z:" + str(path).replace("/", "\\") if IS_WINDOWS else str(path)


@pytest.fixture(scope="module")
def voice(tmp_path_factory):
    """A buzz of one second that swells and fades, in a folder with a non-ASCII name."""
    folder = tmp_path_factory.mktemp("Jürgen Müller ïdées 顔")
    time = np.arange(RATE_HZ) / RATE_HZ
    phase = 2 * np.pi * np.cumsum(120 * (1 + 0.2 * np.sin(9.0 * time))) / RATE_HZ
    buzz = sum(np.sin(k * phase) / k for k in range(1, 20))
    samples = 0.15 * buzz * np.clip(np.sin(2 * np.pi * 4.0 * time), 0.0, None)
    path = folder / "Stimme ü.wav"
    write_wav(path, samples)
    return path


def meshes():
    """The default head, and other meshes if their files are present."""
    yield HEAD / "head.obj"
    folder = SHARED / "data/meshes"
    for name in ("lee_perry_smith.obj", "human_woman.obj", "makehuman_body.obj", "cat.obj",
                 "goathead.obj", "koala.obj", "kaykit_mage.glb", "demosthenes.obj",
                 "mediapipe_canonical_face.obj"):  # fmt: skip
        if (folder / name).is_file():
            yield folder / name


@pytest.mark.parametrize("mesh", list(meshes()), ids=lambda path: path.name)
def test_a_mesh_moves_as_on_this_machine(programs, system, voice, mesh, tmp_path):
    check_alike(programs, system, voice, mesh, "freetalk", tmp_path)


@pytest.mark.parametrize("network", ["cafe-talk", "emoface", "facetalk"])
def test_every_network_speaks_alike(programs, system, voice, network, tmp_path):
    check_alike(programs, system, voice, HEAD / "head.obj", network, tmp_path)


def check_alike(programs, system, voice, mesh, network, tmp_path):
    """Asserts that both commands exit alike, and move the mesh alike if they succeed."""
    copy = voice.parent / f"Köpf {mesh.name}"
    shutil.copy(mesh, copy)
    codes = []
    outs = [tmp_path / "here.npz", tmp_path / "dört.npz"]
    for program, name, out in (
        ([COMMAND], str, outs[0]),
        ([*RUNNER, programs / PROGRAM], named, outs[1]),
    ):
        words = ["animate", "--system", network, "--emotion", "happy:0.7", "--mesh", name(copy),
                 "--audio", name(voice), "--out", name(out)]  # fmt: skip
        done = subprocess.run([*program, *words], env=system, capture_output=True, check=False)
        codes.append((done.returncode, done.stderr.decode(errors="replace")[-500:]))
    assert codes[0][0] == codes[1][0], codes
    if codes[0][0] == 0:
        here, there = (np.load(out)["displacements"] for out in outs)
        size = np.abs(here).max()
        assert here.shape == there.shape and size > 0
        assert np.abs(here - there).max() < 1e-4 * size


def test_results_are_kept_where_the_system_keeps_them(programs, system, voice, tmp_path):
    words = ["animate", "--mesh", named(programs / "head.obj"), "--audio", named(voice), "--out"]
    for name in ("one.npz", "two.npz"):
        run([*RUNNER, programs / PROGRAM, *words, named(tmp_path / name)], system)
    if IS_WINDOWS:
        caches = list(Path(system["WINEPREFIX"]).glob("drive_c/users/*/AppData/Local/anyface*"))
    else:
        caches = list(Path(system["XDG_CACHE_HOME"]).glob("anyface*"))
    assert caches and any(path.is_file() for path in caches[0].rglob("*"))
    # The second run reads the cache and gives the same bytes as the first.
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    left = [path.name for path in tmp_path.iterdir()]
    assert sorted(left) == ["one.npz", "two.npz"]


def test_errors_name_the_file_that_was_meant(programs, system, tmp_path):
    missing = named(tmp_path / "nö such.obj")
    words = ["landmarks", "--mesh", missing, "--out", named(tmp_path / "out.json")]
    done = run([*RUNNER, programs / PROGRAM, *words], system, code=8)
    assert "nö such.obj" in done.stderr


@on_windows
def test_ctrl_c_ends_a_job_and_leaves_nothing(programs, system, voice, tmp_path):
    """Wine passes SIGINT on as Ctrl-C."""
    long = tmp_path / "long.wav"
    with wave.open(str(voice), "rb") as short, wave.open(str(long), "wb") as file:
        file.setparams(short.getparams())
        sound = short.readframes(short.getnframes())
        for _ in range(600):
            file.writeframes(sound)
    out = tmp_path / "out"
    out.mkdir()
    words = ["animate", "--mesh", named(programs / "head.obj"), "--audio", named(long)]
    words += ["--out", named(out / "long.pc2")]
    command = subprocess.Popen(
        [*RUNNER, programs / PROGRAM, *words], env=system, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not list(out.iterdir()) and command.poll() is None and time.monotonic() < deadline:
        time.sleep(0.2)
    assert list(out.iterdir()) and command.poll() is None, "the job ended, or wrote nothing"
    command.send_signal(signal.SIGINT)
    _, message = command.communicate(timeout=120)
    assert command.returncode not in (0, None) and "cancel" in message.lower(), message
    assert list(out.iterdir()) == []


def compiled(source, folder, *more):
    """Compiles a C program for the other system and copies the library beside it."""
    if shutil.which(COMPILER) is None:
        pytest.skip(f"ignored, needs {COMPILER}")
    program = folder / ("host.exe" if IS_WINDOWS else "host")
    library = f"{BUILT}/anyface.dll.lib" if IS_WINDOWS else f"{BUILT}/{LIBRARY}"
    words = ["-std=c11", "-Wall", "-Wextra", "-Werror", f"-I{ROOT}/include", source, *more]
    run([COMPILER, *words, "-o", program, library, "-lm"])
    # On Linux a program looks for the name with the interface's version.
    version = re.search(r"ANYFACE_ABI_VERSION (\d+)", HEADER.read_text(encoding="utf-8"))[1]
    name = LIBRARY if IS_WINDOWS else f"{LIBRARY}.{version}"
    shutil.copy(f"{BUILT}/{LIBRARY}", folder / name)
    return program


def check_host(program, system, programs, sound, tmp_path):
    """Asserts that a C host moves the head as this machine's command does."""
    out, here = tmp_path / "host.npz", tmp_path / "here.npz"
    words = [named(path) for path in (programs / "head.obj", sound, out)]
    environment = {**system, "LD_LIBRARY_PATH": str(program.parent)}
    run([*RUNNER, program, *words, "happy:0.7"], environment)
    words = ["animate", "--mesh", HEAD / "head.obj", "--audio", sound, "--out", here]
    run([COMMAND, *words, "--emotion", "happy:0.7"])
    moved, expected = (np.load(path)["displacements"] for path in (out, here))
    assert np.abs(expected).max() > 1e-3 and np.abs(moved - expected).max() < NEAR_M


def test_a_c_host_speaks(programs, system, voice, tmp_path):
    program = compiled(ROOT / "capi/examples/talk.c", tmp_path)
    plain = tmp_path / "voice.wav"
    shutil.copy(voice, plain)
    check_host(program, system, programs, plain, tmp_path)


@on_windows
def test_a_c_host_with_the_manifest_takes_any_name(programs, system, voice, tmp_path):
    resource = tmp_path / "utf8.o"
    run(["x86_64-w64-mingw32-windres", "-I", ROOT / "capi/examples",
         ROOT / "capi/examples/utf8.rc", resource])  # fmt: skip
    program = compiled(ROOT / "capi/examples/talk.c", tmp_path, resource)
    check_host(program, system, programs, voice, tmp_path)
