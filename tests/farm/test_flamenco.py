"""Runs the output of `--export flamenco` in a stand-in for Flamenco Manager.

The stand-in follows Flamenco's documentation.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

STAGE = Path(__file__).with_name("flamenco_stage.js")


def compile_job(folder: Path) -> list[dict]:
    """The tasks that Flamenco makes from a job."""
    if shutil.which("node") is None:
        pytest.skip("ignored, needs node")
    done = run_stage(folder / "anyface.js", folder / "job.json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def run_stage(script: Path, job: Path) -> subprocess.CompletedProcess:
    return subprocess.run(
        ["node", str(STAGE), str(script), str(job)], capture_output=True, text=True, check=False
    )


def change(folder: Path, **settings):
    """Changes settings of a job."""
    job = json.loads((folder / "job.json").read_text())
    job["settings"].update(settings)
    (folder / "job.json").write_text(json.dumps(job))


def perform(task: dict, blender: Path, environment: dict):
    """Runs the commands of a task as a worker does, with its variable for Blender."""
    for command in task["commands"]:
        words = [command["parameters"]["exe"], *command["parameters"]["args"]]
        words = [word.replace("{blender}", str(blender)) for word in words]
        subprocess.run(words, env={**os.environ, **environment}, check=True, capture_output=True)


def test_tasks_that_flamenco_runs_finish_every_row(farm):
    farm.write(5)
    tasks = compile_job(farm.export("flamenco", "--chunk", 2))
    assert [task["name"] for task in tasks] == ["rows-1-2", "rows-3-4", "rows-5-5", "sum"]
    assert tasks[-1]["dependencies"] == ["rows-1-2", "rows-3-4", "rows-5-5"]
    assert {task["commands"][0]["parameters"]["exe"] for task in tasks} == {"{blender}"}
    for task in tasks:
        perform(task, farm.blender, farm.environment(0.05))
    farm.check_whole(5)
    assert farm.total()["ok"] == 5


def test_renders_wait_for_the_bake_of_their_row(farm):
    farm.write(3)
    jobs = json.loads(farm.jobs.read_text())
    jobs["shots"][1] = "no row"
    farm.jobs.write_text(json.dumps(jobs))
    folder = farm.export("flamenco", "--chunk", 2)
    change(folder, render_output_root="/renders", frames="1-4,9", frames_per_task=2)
    tasks = {task["name"]: task for task in compile_job(folder)}
    renders = {name: task for name, task in tasks.items() if name.startswith("render-")}
    assert len(renders) == 2 * 3
    assert renders["render-sh0001-1,2"]["dependencies"] == ["rows-1-2"]
    assert renders["render-sh0003-9"]["dependencies"] == ["rows-3-3"]
    command = renders["render-sh0003-3,4"]["commands"][0]
    assert command["name"] == "blender-render"
    assert command["parameters"]["blendfile"] == str(farm.folder / "out/sh0003.blend")
    assert command["parameters"]["args"] == [
        *("--render-output", "/renders/sh0003/######"),
        *("--render-format", "PNG", "--render-frame", "3,4"),
    ]


def test_renders_without_frames_are_refused_with_a_remedy(farm):
    farm.write(2)
    folder = farm.export("flamenco")
    change(folder, render_output_root="/renders")
    assert "such as '1-30'" in run_stage(folder / "anyface.js", folder / "job.json").stderr


@pytest.mark.parametrize(
    ("was", "becomes", "said"),
    [
        ("shellSplit(", "splitShell(", "splitShell is not defined"),
        ('type: "int32", required', 'type: "int", required', "unknown type int"),
        ("exe: words[0]", "program: words[0]", "unknown parameter program"),
        ('author.Command("exec"', 'author.Command("run"', "unknown command run"),
        ("author.Task(", "author.Job(", "author.Job is unknown"),
        ('"blender");\n    sum', '"gpu");\n    sum', "unknown task type gpu"),
        ("job.settings", "job.options", "job.options is unknown"),
    ],
)
def test_the_stand_in_refuses_what_flamenco_does_not_document(farm, was, becomes, said):
    farm.write(2)
    folder = farm.export("flamenco")
    text = (folder / "anyface.js").read_text()
    assert was in text
    (folder / "anyface.js").write_text(text.replace(was, becomes))
    assert said in run_stage(folder / "anyface.js", folder / "job.json").stderr
