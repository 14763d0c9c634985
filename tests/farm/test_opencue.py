"""OpenCue's own library builds the job that `--export opencue` writes, without a Cuebot."""

import importlib.util
import os
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

# The order of a layer's fields in cjsl-1.15.dtd.
LAYER = ("cmd", "range", "chunk", "cores", "threadable", "memory", "env", "services", "outputs")


def description(farm, *words) -> ElementTree.Element:
    """The job as Cuebot gets it."""
    return description_of(farm.export("opencue", *words) / "submit.py", farm.folder)


def description_of(script, home) -> ElementTree.Element:
    """The job that a script hands in. OpenCue writes files into the folder `home`."""
    if importlib.util.find_spec("outline") is None:
        pytest.skip("ignored, needs opencue-pyoutline")
    done = subprocess.run(
        [sys.executable, str(script), "--print"],
        env={**os.environ, "HOME": str(home)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return ElementTree.fromstring(done.stdout[done.stdout.index("<?xml") :])


def frames(layer) -> list[tuple[int, int]]:
    """First and last frame of each chunk, which Cuebot puts into the command."""
    first, last = map(int, layer.findtext("range").split("-"))
    size = int(layer.findtext("chunk"))
    # Many versions of Cuebot do not cut the last chunk at the end of the range.
    return [(start, start + size - 1) for start in range(first, last + 1, size)]


def run_frames(layer, environment: dict):
    """Runs the command of each chunk of a layer as a host of OpenCue does."""
    for first, last in frames(layer):
        text = layer.findtext("cmd")
        text = text.replace("#FRAME_START#", str(first)).replace("#FRAME_END#", str(last))
        subprocess.run(["sh", "-c", text], env={**os.environ, **environment}, check=True)


def test_frames_that_cuebot_runs_finish_every_row(farm):
    farm.write(5)
    job = description(farm, "--chunk", 2, "--memory", 3, "--cores", 2)
    layers = {layer.get("name"): layer for layer in job.iter("layer")}
    assert list(layers) == ["shots", "rest", "sum"]
    for name, layer in layers.items():
        run_frames(layer, farm.environment(0.05))
        assert name == "sum" or farm.written()
    farm.check_whole(5)
    assert set(farm.written().values()) == {1} and farm.total()["ok"] == 5


def test_the_description_has_what_cuebot_reads(farm):
    farm.write(4)
    job = description(farm, "--chunk", 2, "--memory", 3, "--cores", 2)
    shots, total = job.iter("layer")
    assert (shots.findtext("memory"), shots.findtext("cores")) == ("3072m", "2.0")
    assert (shots.findtext("range"), shots.findtext("chunk")) == ("1-4", "2")
    for layer in (shots, total):
        fields = [field.tag for field in layer]
        assert fields == [field for field in LAYER if field in fields]
    (depend,) = job.iter("depend")
    assert depend.get("type") == "LAYER_ON_LAYER"
    assert (depend.findtext("deplayer"), depend.findtext("onlayer")) == ("sum", "shots")


def test_a_shell_gets_the_words_as_they_are(farm):
    farm.jobs = farm.folder / "it's $HOME & more.json"
    farm.write(2)
    (shots, _) = description(farm).iter("layer")
    assert shlex.split(shots.findtext("cmd"))[5] == str(farm.jobs)
