"""A folder with one .blend, one sound and a jobs file, to run batches in."""

import collections
import json
import os
import re
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest

from figures import grid, tone

# If a batch takes longer than this, it hangs, and its test fails.
LIMIT_S = 120
STAGE = Path(__file__).parent / "stage_blender.py"


class Floor:
    """A folder with one .blend, one sound and a jobs file; runs the batch as a farm would."""

    def __init__(self, folder: Path, extension: Path):
        if os.name == "nt":
            pytest.skip("ignored, the stand-in for Blender is a shell script")
        self.folder, self.extension = folder, extension
        self.jobs, self.reports = folder / "jobs.json", folder / "jobs.reports"
        self.marks = folder / "marks"
        self.marks.mkdir()
        self.blender = folder / "blender"
        self.blender.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{STAGE}" "$@"\n')
        self.blender.chmod(self.blender.stat().st_mode | stat.S_IXUSR)
        grid()
        tone(folder / "voice.wav")
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "shot.blend"))

    def write(self, count: int, **more):
        """A jobs file of `count` equal shots."""
        shots = [{"save": f"out/sh{n:02d}.blend", "seed": n} for n in range(count)]
        defaults = {"file": "shot.blend", "object": "Head", "audio": "voice.wav", **more}
        self.jobs.write_text(json.dumps({"defaults": defaults, "shots": shots}))

    def environment(self, seconds: float) -> dict:
        """Environment variables for the stand-in for Blender. A face takes `seconds`."""
        return {
            "ANYFACE_TEST_EXTENSION": str(self.extension),
            "ANYFACE_TEST_MARKS": str(self.marks),
            "ANYFACE_TEST_S": str(seconds),
        }

    def start(self, *words, seconds=0.0, more=None) -> subprocess.Popen:
        """Starts the batch."""
        command = [sys.executable, str(self.extension / "anyface_batch.py"), "batch", self.jobs]
        return subprocess.Popen(
            [*map(str, command), "--blender", str(self.blender), *map(str, words)],
            env={**os.environ, **self.environment(seconds), **(more or {})},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            # If a shell runs the tests in the background, they ignore SIGINT: restore it.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def run(self, *words, **more) -> tuple[int, str]:
        """Runs the batch. Returns its exit code and its output."""
        process = self.start(*words, **more)
        try:
            text = process.communicate(timeout=LIMIT_S)[0]
        finally:
            process.kill()
        return process.returncode, text

    def report(self, name: str) -> dict:
        """The report of a shot."""
        return json.loads((self.reports / f"{name}.json").read_text())

    def ended(self) -> collections.Counter:
        """How often each shot ended, over all runs."""
        lines = (self.reports / "history.jsonl").read_text().splitlines()
        return collections.Counter(json.loads(line)["name"] for line in lines)

    def begun(self) -> list[tuple[int, int]]:
        """Parent and process ids of every face that was begun, in the order of their starts."""
        marks = sorted(self.marks.glob("begun-*"), key=lambda path: path.stat().st_mtime_ns)
        names = [path.name.split("-") for path in marks]
        return [(int(words[1]), int(words[2])) for words in names]

    def wait_begun(self, count: int):
        """Waits until `count` faces were begun."""
        for _ in range(600):
            if len(self.begun()) >= count:
                return
            time.sleep(0.1)
        raise AssertionError(f"only {len(self.begun())} of {count} faces were begun in a minute")


def rows_of(page: str) -> list[dict]:
    """The rows in the results page of a batch."""
    (text,) = re.findall(r'<script id="data"[^>]*>(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def wait_gone(process_id: int):
    """Waits until a process has ended."""
    for _ in range(100):
        try:
            state = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            return
        if state == "Z":
            return
        time.sleep(0.1)
    raise AssertionError(f"process {process_id} still runs")
