"""The site that `cargo xtask site` writes, and a server that only this machine can reach.

`ANYFACE_EXTENSION` and `ANYFACE_WHEEL` name a zip and a wheel for this machine. Without them the
tests build both.
"""

import contextlib
import functools
import http.server
import os
import re
import shutil
import subprocess
import sys
import threading
import zipfile
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import ROOT, find_wheel, spoken, write_wav

HEAD = ROOT / "weights/shared/default_head/head.obj"
HERE = "linux-x64"
OTHERS = ("macos-arm64", "windows-x64")


@pytest.fixture(scope="session")
def extension(tmp_path_factory):
    """The extension's zip."""
    path = os.environ.get("ANYFACE_EXTENSION")
    if path:
        return Path(path).resolve()
    path = tmp_path_factory.mktemp("extension") / "anyface.zip"
    subprocess.run(["cargo", "xtask", "extension", "--out", path], cwd=ROOT, check=True)
    return path


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    """The Python wheel."""
    return find_wheel(tmp_path_factory.mktemp("wheel"))


def repack(extension: Path, folder: Path, version: str, system: str) -> None:
    """Writes the zip with this version for this system. Only `HERE` gets the library."""
    path = folder / f"anyface-{version}-{system}.zip"
    with zipfile.ZipFile(extension) as old, zipfile.ZipFile(path, "w") as new:
        for item in old.infolist():
            content = old.read(item)
            if item.filename == "blender_manifest.toml":
                text = re.sub(r'(?m)^version = ".*"$', f'version = "{version}"', content.decode())
                text = re.sub(r"(?m)^platforms = .*$", f'platforms = ["{system}"]', text)
                content = text.encode()
            if system == HERE or not item.filename.startswith("lib/"):
                new.writestr(item, content)


def packages(extension: Path, folder: Path, version: str) -> Path:
    """Fills a new folder with the extension for three systems; returns the folder."""
    folder.mkdir()
    for system in (HERE, *OTHERS):
        repack(extension, folder, version, system)
    return folder


def write_site(out: Path, *words) -> str:
    """Runs `cargo xtask site`; returns its output."""
    command = ["cargo", "xtask", "site", "--out", out, *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def site(extension, wheel, tmp_path_factory):
    """The folder of a site. The file `said.txt` beside it holds the output of the task."""
    folder = tmp_path_factory.mktemp("site")
    packed = packages(extension, folder / "packages", "0.1.0")
    shutil.copy(wheel, packed)
    # The content of a C library's archive is tested where it is packed.
    (packed / f"anyface-0.1.0-{HERE}.tar.gz").write_bytes(b"stands for an archive")
    (folder / "said.txt").write_text(write_site(folder / "out", "--packages", packed))
    return folder / "out"


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves a folder and writes no log."""

    def log_message(self, *_):
        """Says nothing."""


@contextlib.contextmanager
def served(folder: Path):
    """Serves a folder to this machine; gives its address."""
    handler = functools.partial(Quiet, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def install_npm(package: str, folder: Path) -> Path:
    """Installs a package of npm; returns the folder of packages.

    Without npm the test is ignored, or fails if `CI` is set.
    """
    if not shutil.which("npm"):
        if os.environ.get("CI"):
            pytest.fail("npm is not installed")
        pytest.skip("ignored: npm is not installed")
    words = ["npm", "install", "--silent", "--no-save", "--no-audit", package]
    subprocess.run(words, cwd=folder, check=True)
    return folder / "node_modules"


@pytest.fixture(scope="session")
def voice(tmp_path_factory):
    """A WAV file: a buzz of 120 Hz through the formants of a, four syllables a second."""
    path = tmp_path_factory.mktemp("voice") / "voice.wav"
    write_wav(path, spoken())
    return path
