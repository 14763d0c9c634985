"""The command and the library for Windows, run by Wine, against those of this machine.

`ANYFACE_WINE` runs programs of Windows, `ANYFACE_WINDOWS` is the folder with anyface.exe and
anyface.dll, `ANYFACE_COMMAND` the command of this machine. Without them the tests are ignored.
"""

import os
import shutil
import subprocess
import wave
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("ANYFACE_SHARED", ROOT / "../shared"))
HEAD = ROOT / "weights/shared/default_head"
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
WINE, WINDOWS = os.environ.get("ANYFACE_WINE"), os.environ.get("ANYFACE_WINDOWS")
COMPILER = "x86_64-w64-mingw32-gcc"
RATE_HZ = 16000
# Sines and exponentials of another C library.
NEAR_M = 1e-5

pytestmark = pytest.mark.skipif(
    not (WINE and WINDOWS), reason="ignored, needs ANYFACE_WINE and ANYFACE_WINDOWS"
)


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """A folder with the command and the library: Wine may see temporary files alone."""
    folder = tmp_path_factory.mktemp("programs")
    for name in ("anyface.exe", "anyface.dll"):
        shutil.copy(f"{WINDOWS}/{name}", folder)
    shutil.copy(HEAD / "head.obj", folder)
    return folder


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    """The environment of a Windows of its own."""
    folder = tmp_path_factory.mktemp("wine")
    hidden = {"DISPLAY", "ANYFACE_CACHE"}
    kept = {name: value for name, value in os.environ.items() if name not in hidden}
    environment = {**kept, "WINEPREFIX": str(folder), "WINEDEBUG": "-all", "LANG": "C.UTF-8"}
    run([WINE, "wineboot", "--init"], environment)
    return environment


def run(words, environment=None, code=0):
    """What a program writes."""
    done = subprocess.run(
        words, env=environment, capture_output=True, text=True, encoding="utf-8", errors="replace",
        check=False,
    )  # fmt: skip
    assert done.returncode == code, f"{done.returncode}: {done.stdout}{done.stderr}"
    return done


def named(path):
    """How Windows names a file of this machine."""
    return "Z:" + str(path).replace("/", "\\")


@pytest.fixture(scope="module")
def voice(tmp_path_factory):
    """A second of a buzz that opens and closes, in a folder whose name is no ASCII."""
    folder = tmp_path_factory.mktemp("Jürgen Müller ïdées 顔")
    time = np.arange(RATE_HZ) / RATE_HZ
    phase = 2 * np.pi * np.cumsum(120 * (1 + 0.2 * np.sin(9.0 * time))) / RATE_HZ
    buzz = sum(np.sin(k * phase) / k for k in range(1, 20))
    samples = 0.15 * buzz * np.clip(np.sin(2 * np.pi * 4.0 * time), 0.0, None)
    path = folder / "Stimme ü.wav"
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes((samples * 32767).astype("<i2").tobytes())
    return path


def meshes():
    """The default head, and where they are at hand ten others."""
    yield HEAD / "head.obj"
    folder = SHARED / "data/meshes"
    for name in ("lee_perry_smith.obj", "human_woman.obj", "makehuman_body.obj", "cat.obj",
                 "goathead.obj", "koala.obj", "kaykit_mage.glb", "demosthenes.obj",
                 "mediapipe_canonical_face.obj"):  # fmt: skip
        if (folder / name).is_file():
            yield folder / name


@pytest.mark.parametrize("mesh", list(meshes()), ids=lambda path: path.name)
@pytest.mark.parametrize("system", ["freetalk"])
def test_a_mesh_moves_as_on_this_machine(programs, prefix, voice, mesh, system, tmp_path):
    check_alike(programs, prefix, voice, mesh, system, tmp_path)


@pytest.mark.parametrize("system", ["cafe-talk", "emoface", "facetalk"])
def test_every_system_speaks_alike(programs, prefix, voice, system, tmp_path):
    check_alike(programs, prefix, voice, HEAD / "head.obj", system, tmp_path)


def check_alike(programs, prefix, voice, mesh, system, tmp_path):
    """Both commands say the same of a mesh, and move it alike where they do."""
    copy = voice.parent / f"Köpf {mesh.name}"
    shutil.copy(mesh, copy)
    codes = []
    outs = [tmp_path / "here.npz", tmp_path / "dört.npz"]
    for program, name, out in (
        ([COMMAND], str, outs[0]),
        ([WINE, programs / "anyface.exe"], named, outs[1]),
    ):
        words = ["animate", "--system", system, "--emotion", "happy:0.7", "--mesh", name(copy),
                 "--audio", name(voice), "--out", name(out)]  # fmt: skip
        done = subprocess.run([*program, *words], env=prefix, capture_output=True, check=False)
        codes.append((done.returncode, done.stderr.decode(errors="replace")[-500:]))
    assert codes[0][0] == codes[1][0], codes
    if codes[0][0] == 0:
        here, there = (np.load(out)["displacements"] for out in outs)
        size = np.abs(here).max()
        assert here.shape == there.shape and size > 0
        assert np.abs(here - there).max() < 1e-4 * size


def test_results_are_kept_where_windows_keeps_them(programs, prefix, voice, tmp_path):
    words = ["animate", "--mesh", named(programs / "head.obj"), "--audio", named(voice), "--out"]
    for name in ("one.npz", "two.npz"):
        run([WINE, programs / "anyface.exe", *words, named(tmp_path / name)], prefix)
    local = list(Path(prefix["WINEPREFIX"]).glob("drive_c/users/*/AppData/Local/anyface*"))
    assert local and any(path.is_file() for path in local[0].rglob("*"))
    # What was read from there is what was computed.
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    left = [path.name for path in tmp_path.iterdir()]
    assert sorted(left) == ["one.npz", "two.npz"]


def test_errors_name_the_file_that_was_meant(programs, prefix, tmp_path):
    missing = named(tmp_path / "nö such.obj")
    words = ["landmarks", "--mesh", missing, "--out", named(tmp_path / "out.json")]
    done = run([WINE, programs / "anyface.exe", *words], prefix, code=8)
    assert "nö such.obj" in done.stderr


def test_a_c_host_speaks(programs, prefix, voice, tmp_path):
    if shutil.which(COMPILER) is None:
        pytest.skip(f"ignored, needs {COMPILER}")
    program = tmp_path / "talk.exe"
    words = ["-std=c11", "-Wall", "-Wextra", "-Werror", f"-I{ROOT}/include"]
    words += [ROOT / "capi/examples/talk.c", "-o", program, f"-L{WINDOWS}", "-lanyface"]
    run([COMPILER, *words])
    shutil.copy(f"{WINDOWS}/anyface.dll", tmp_path)
    plain = tmp_path / "voice.wav"
    shutil.copy(voice, plain)
    out = tmp_path / "talk.npz"
    run(
        [WINE, program, named(programs / "head.obj"), named(plain), named(out), "happy:0.7"], prefix
    )
    here = tmp_path / "here.npz"
    words = ["animate", "--mesh", HEAD / "head.obj", "--audio", plain, "--out", here]
    run([COMMAND, *words, "--emotion", "happy:0.7"])
    moved, expected = (np.load(path)["displacements"] for path in (out, here))
    assert np.abs(expected).max() > 1e-3 and np.abs(moved - expected).max() < NEAR_M
