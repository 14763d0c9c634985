"""`openjd`, the tool of the standard, checks and runs what `--export openjd` writes."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


def openjd(*words, environment=None) -> str:
    """Runs `openjd`; returns its output."""
    if importlib.util.find_spec("openjd.cli") is None:
        pytest.skip("ignored, needs openjd-cli")
    program = shutil.which("openjd", path=str(Path(sys.executable).parent))
    done = subprocess.run(
        [program, *map(str, words)],
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_the_template_is_valid(farm):
    farm.write(5)
    template = farm.export("openjd") / "template.yaml"
    assert "passes validation checks" in openjd("check", template)


def test_all_chunks_finish_every_row_and_write_the_sum(farm):
    farm.write(5)
    template = farm.export("openjd", "--chunk", 2) / "template.yaml"
    said = openjd("run", template, "--step", "Shots", environment=farm.environment(0.05))
    assert "Chunks run: 3" in said or "Tasks run: 3" in said, said
    farm.check_whole(5)
    assert farm.total()["ok"] == 5


def test_one_task_does_its_rows_alone(farm):
    farm.write(5)
    template = farm.export("openjd", "--chunk", 2) / "template.yaml"
    words = ("--step", "Shots", "--task-param", "Rows=3-4")
    openjd("run", template, *words, environment=farm.environment(0.05))
    assert dict(farm.written()) == {"sh0003": 1, "sh0004": 1}
