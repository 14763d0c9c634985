"""Batches and commands without a window end with a report, whatever is raised, and wherever.

This is the generated test of `test_job_ends` for the farm.
"""

import argparse
import json
import os
import stat
import sys
from pathlib import Path

import bpy
import pytest

from faults import ERRORS, Fault, steps_of
from figures import grid, stand_in, tone

# Replaces Blender: writes the requested file and its report.
WORKER = """#!{python}
import json, os, sys
shot = json.loads(sys.stdin.readline())
os.makedirs(os.path.dirname(shot["save"]), exist_ok=True)
open(shot["save"], "w").close()
report = {{"name": shot["name"], "ok": True, "message": "done", "exit_code": 0,
           "digest": shot["digest"]}}
with open(shot["report"], "w") as file:
    json.dump(report, file)
"""
# These functions catch the exceptions, so the test does not make them raise any.
NET = {"run", "close", "main", "measured", "say", "start", "_listen"}


@pytest.fixture
def farm(tmp_path):
    """A jobs file of three rows, one of them broken, and the options of a batch."""
    worker = tmp_path / "worker"
    worker.write_text(WORKER.format(python=sys.executable))
    worker.chmod(worker.stat().st_mode | stat.S_IXUSR)
    (tmp_path / "shot.blend").touch()
    rows = [{"save": f"out/{n}.blend", "file": "shot.blend", "object": "H"} for n in range(2)]
    (tmp_path / "jobs.json").write_text(json.dumps({"shots": [*rows, "broken"]}))
    return argparse.Namespace(
        jobs=str(tmp_path / "jobs.json"),
        reports=None,
        workers=2,
        scheduler=None,
        export=None,
        chunk=2,
        rows=None,
        map=[],
        sum=False,
        dry_run=False,
        blender=str(worker),
        retries=0,
        timeout=20.0,
        again=True,
    )


def half_written(folder: Path) -> list[str]:
    """Hidden and partial files that were left in the folder."""
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    paths = [path for path in paths if path.name != ".anyface-receipts"]
    return [str(path) for path in paths if path.name.startswith(".") or "part" in path.name]


def test_a_batch_ends_whatever_is_raised(addon, installed, farm, tmp_path, capfd):
    batch = addon("farm.batch")
    with Fault(installed) as fault:
        assert batch.run(farm) == 12
    steps = [(code, n) for code, n in steps_of(fault.calls, installed) if code.co_name not in NET]
    failures = []
    for number, (code, calls) in enumerate(steps):
        error, at = ERRORS[number % len(ERRORS)](), calls if number % 2 else 1
        where = f"{Path(code.co_filename).name}:{code.co_name} {at}/{calls} {type(error).__name__}"
        capfd.readouterr()
        try:
            with Fault(installed, code, at, error):
                exit_code = batch.run(farm)
        except BaseException as raised:
            failures.append(f"{where}: raised {type(raised).__name__}: {raised}")
            continue
        said = capfd.readouterr().err
        if exit_code == 0 or "anyface: " not in said:
            failures.append(f"{where}: {exit_code} {said}")
        if half_written(tmp_path):
            failures.append(f"{where}: {half_written(tmp_path)}")
    print(f"{len(steps)} steps")
    assert batch.run(farm) == 12 and not failures, "\n".join(failures)
    summary = json.loads((tmp_path / "jobs.reports" / "batch.json").read_text())
    assert summary["ok"] == 2 and summary["failed"] == ["row-3"]


def test_a_shot_whose_report_cannot_be_written_is_told(addon, farm, tmp_path, capfd):
    reports = tmp_path / "reports"
    reports.write_text("a file")
    farm.reports = str(reports)
    assert addon("farm.batch").run(farm) in (8, 12)
    assert "anyface: " in capfd.readouterr().err


def test_baking_ends_with_a_report_whatever_is_raised(addon, installed, tmp_path, capfd):
    stand_in(addon)
    bpy.context.scene.render.fps = 24
    grid()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    report, save = tmp_path / "report.json", tmp_path / "out.blend"
    words = ["bake", "--file", str(tmp_path / "shot.blend"), "--object", "Head", "--quiet"]
    words += ["--audio", tone(tmp_path / "a.wav", 0.5), "--save", str(save)]
    words += ["--report", str(report)]
    main = addon("command").main
    with Fault(installed) as fault:
        assert main(words) == 0
    steps = [(code, n) for code, n in steps_of(fault.calls, installed) if code.co_name not in NET]
    steps = [step for step in steps if "/ui/" not in step[0].co_filename]
    failures = []
    for number, (code, calls) in enumerate(steps):
        error, at = ERRORS[number % len(ERRORS)](), calls if number % 2 else 1
        where = f"{Path(code.co_filename).name}:{code.co_name} {at}/{calls} {type(error).__name__}"
        for path in (report, save):
            path.unlink(missing_ok=True)
        capfd.readouterr()
        try:
            with Fault(installed, code, at, error):
                exit_code = main(words)
        except BaseException as raised:
            failures.append(f"{where}: raised {type(raised).__name__}: {raised}")
            continue
        said = capfd.readouterr().err
        stands = exit_code == 0 and save.exists() and report.exists()
        if not stands and "anyface: " not in said and "usage" not in said:
            failures.append(f"{where}: {exit_code} {said}")
        if half_written(tmp_path):
            failures.append(f"{where}: {half_written(tmp_path)}")
            for name in half_written(tmp_path):
                os.unlink(tmp_path / name)
    print(f"{len(steps)} steps")
    assert main(words) == 0 and not failures, "\n".join(failures)
