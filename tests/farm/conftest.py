"""Fixtures for farms: a jobs file, and a stand-in for Blender that does its shots.

`ANYFACE_EXTENSION` names the extension's zip or its folder. Without it a zip is built. The farm
engines need `tests/farm/requirements.txt`, node, and Debian's packages slurm-wlm, munge and
iproute2. A test whose engine is missing is ignored, and names it.
"""

import collections
import json
import os
import shlex
import stat
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

ROOT = Path(__file__).resolve().parents[2]
STAGE = Path(__file__).with_name("stage_blender.py")


@pytest.fixture(scope="session")
def extension(tmp_path_factory) -> Path:
    """The folder of the extension."""
    path = os.environ.get("ANYFACE_EXTENSION")
    if not path:
        path = tmp_path_factory.mktemp("zip") / "anyface.zip"
        subprocess.run(["cargo", "xtask", "extension", "--out", path], cwd=ROOT, check=True)
    if Path(path).is_dir():
        return Path(path).resolve()
    folder = tmp_path_factory.mktemp("extension")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


class Farm:
    """A jobs file in a folder, with its reports and results."""

    def __init__(self, folder: Path, extension: Path):
        self.folder, self.extension = folder, extension
        self.jobs, self.reports = folder / "jobs.json", folder / "jobs.reports"
        self.blender = folder / "blender"
        python, stage = shlex.quote(sys.executable), shlex.quote(str(STAGE))
        self.blender.write_text(
            f'#!/bin/sh\nexport ANYFACE_TEST_BLENDER="$0"\nexec {python} {stage} "$@"\n'
        )
        self.blender.chmod(self.blender.stat().st_mode | stat.S_IXUSR)
        (folder / "shot.blend").touch()

    def write(self, count: int):
        """Writes a jobs file of `count` equal shots."""
        shots = [{"save": f"out/{name}.blend"} for name in self.names(count)]
        content = {"defaults": {"file": "shot.blend", "object": "Head"}, "shots": shots}
        self.jobs.write_text(json.dumps(content))

    @staticmethod
    def names(count: int) -> list[str]:
        """The names of `count` shots."""
        return [f"sh{number:04d}" for number in range(1, count + 1)]

    def environment(self, seconds: float) -> dict:
        """Environment variables for the stand-in for Blender; a shot takes `seconds`."""
        return {"ANYFACE_TEST_EXTENSION": str(self.extension), "ANYFACE_TEST_S": str(seconds)}

    def batch(self, *words) -> subprocess.CompletedProcess:
        """Runs `batch` on the jobs file with this Python."""
        command = [sys.executable, self.extension / "anyface_batch.py", "batch", self.jobs]
        return subprocess.run(
            [*map(str, command), "--blender", str(self.blender), *map(str, words)],
            env={**os.environ, **self.environment(0.1)},
            capture_output=True,
            text=True,
            check=False,
        )

    def export(self, engine: str, *words) -> Path:
        """Exports for an engine; returns the folder of its files."""
        done = self.batch("--export", engine, *words)
        assert done.returncode == 0, done.stderr
        return self.jobs.with_suffix(f".{engine}")

    def written(self) -> collections.Counter:
        """How many times the file of each shot was really written."""
        lines = (self.reports / "written.txt").read_text().splitlines()
        return collections.Counter(line.split()[0] for line in lines)

    def hosts(self) -> set[str]:
        """The hosts that have written files."""
        path = self.reports / "written.txt"
        lines = path.read_text().splitlines() if path.is_file() else []
        return {line.split()[1] for line in lines}

    def total(self) -> dict:
        """The sum of all reports."""
        return json.loads((self.reports / "batch.json").read_text())

    def check_whole(self, count: int):
        """Asserts that all shots are finished, every file is whole, and no other file is there."""
        files = {path.name: path.read_text() for path in (self.folder / "out").iterdir()}
        assert files == {
            f"{name}.blend": f"{name} begins\n{name} ends\n" for name in self.names(count)
        }
        for name in self.names(count):
            assert json.loads((self.reports / f"{name}.json").read_text())["ok"]
        hidden = [path.name for path in self.reports.iterdir() if path.name.startswith(".")]
        assert {".claims"} <= {*hidden} <= {".claims", ".anyface-receipts"}


@pytest.fixture
def farm(tmp_path, extension) -> Farm:
    """A folder to run batches in."""
    return Farm(tmp_path, extension)
