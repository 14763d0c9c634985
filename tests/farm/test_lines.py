"""Each farm engine does the lines of speech that `anyface batch --export` hands to it.

`ANYFACE_COMMAND` names the command.
"""

import array
import json
import math
import os
import subprocess
import wave
from pathlib import Path

import pytest

import slurm
from test_flamenco import compile_job, perform
from test_opencue import description_of, run_frames
from test_openjd import openjd

COMMAND = os.environ.get("ANYFACE_COMMAND", "")
pytestmark = pytest.mark.skipif(not COMMAND, reason="ignored, needs ANYFACE_COMMAND")

LINES = 3


class Lines:
    """A table of lines of half a second, in a folder whose name a shell would split."""

    def __init__(self, folder: Path):
        self.folder = folder / "it's $HOME & more"
        self.folder.mkdir()
        self.table, self.reports = self.folder / "lines.csv", self.folder / "lines.reports"
        tone = [int(9000 * math.sin(0.09 * n) * math.sin(0.0008 * n)) for n in range(8000)]
        with wave.open(str(self.folder / "a.wav"), "wb") as sound:
            sound.setnchannels(1)
            sound.setsampwidth(2)
            sound.setframerate(16_000)
            sound.writeframes(array.array("h", tone).tobytes())
        rows = [f"a.wav,out {number}.npz" for number in range(LINES)]
        self.table.write_text("\n".join(["audio,out", *rows, ""]))

    def export(self, engine: str, *words) -> Path:
        """Exports for an engine, two lines a task; returns the folder of its files."""
        command = [COMMAND, "batch", str(self.table), "--export", engine, "--chunk", "2", *words]
        subprocess.run(command, check=True, capture_output=True)
        return self.table.with_suffix(f".{engine}")

    def check_done(self):
        """Asserts that each line was done once, and that the sum and the page are there."""
        history = (self.reports / "history.jsonl").read_text().splitlines()
        assert sorted(json.loads(line)["name"] for line in history) == [
            f"out {number}.npz" for number in range(LINES)
        ]
        assert all((self.folder / f"out {number}.npz").is_file() for number in range(LINES))
        assert json.loads((self.reports / "batch.json").read_text())["ok"] == LINES
        assert (self.reports / "results.html").is_file()


@pytest.fixture
def lines(tmp_path) -> Lines:
    return Lines(tmp_path)


def test_flamenco_does_every_line(lines):
    tasks = compile_job(lines.export("flamenco"))
    assert [task["name"] for task in tasks] == ["rows-1-2", "rows-3-3", "sum"]
    for task in tasks:
        perform(task, Path("blender"), {})
    lines.check_done()


def test_open_job_description_does_every_line(lines):
    template = lines.export("openjd") / "template.yaml"
    assert "passes validation checks" in openjd("check", template)
    openjd("run", template, "--step", "Shots")
    lines.check_done()


def test_opencue_does_every_line(lines):
    job = description_of(lines.export("opencue") / "submit.py", lines.folder)
    for layer in job.iter("layer"):
        run_frames(layer, {})
    lines.check_done()


@pytest.mark.skipif(bool(slurm.missing()), reason=f"ignored: {slurm.missing()}")
def test_slurm_does_every_line(lines, tmp_path_factory):
    script = lines.export("slurm", "--cores", "1", "--memory", "0.5") / "anyface.sh"
    cluster = slurm.Slurm(tmp_path_factory.mktemp("slurm"), 2, {})
    try:
        assert "to start at" in cluster.run("sbatch", "--test-only", script)
        cluster.run("bash", script)
        cluster.wait_ended()
    finally:
        cluster.close()
    lines.check_done()
