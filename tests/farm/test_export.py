"""`batch --export`: how it fills in the templates, and which inputs it refuses."""

import json
import re
import shlex
import subprocess

import pytest

from conftest import ROOT

TEMPLATES = ROOT / "cli/farm"
ENGINES = {
    "flamenco": ("flamenco.json",),
    "openjd": ("openjd.yaml",),
    "slurm": ("slurm.sh",),
    "opencue": ("opencue.py",),
}
# Characters that shells, JSON, YAML or our own placeholders could take for their syntax.
HOSTILE = 'it\'s "$HOME" `a` #1 & %j \\n \u00e9 {{rows}} {{Param.Rows}}.json'


def node_words(farm, engine: str, folder) -> list[str]:
    """The command line that a node gets, read from the exported file of an engine."""
    if engine == "slurm":
        text = (folder / "anyface.sh").read_text()
        (line,) = re.findall(r"^command=\((.*)\)$", text, re.MULTILINE)
        return shlex.split(line)
    if engine == "opencue":
        text = (folder / "submit.py").read_text()
        return json.loads(re.search(r"^COMMAND = (\[.*\])$", text, re.MULTILINE)[1])
    settings = json.loads((folder / "job.json").read_text())["settings"]
    words = [settings["command"], shlex.quote(settings["jobs"]), settings["options"]]
    return shlex.split(" ".join(words).replace("{blender}", str(farm.blender)))


@pytest.mark.parametrize("engine", ["flamenco", "slurm", "opencue"])
def test_words_arrive_as_they_are(farm, engine):
    farm.jobs = farm.folder / HOSTILE
    farm.write(3)
    reports = farm.folder / "its reports"
    words = ("--reports", reports, "--retries", 3, "--timeout", 90, "--chunk", 7)
    folder = farm.export(engine, *words, "--map", r"/mnt/a show=Z:\a show")
    words = node_words(farm, engine, folder)
    assert words == [
        *(str(farm.blender), "-b", "--command", "anyface", "batch", str(farm.jobs)),
        *("--reports", str(reports), "--chunk", "7", "--retries", "3", "--timeout", "90"),
        *("--map", r"/mnt/a show=Z:\a show"),
    ]


def test_a_script_of_slurm_runs_its_rows(farm):
    farm.write(5)
    shown = farm.folder / "blender"
    shown.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    script = farm.export("slurm", "--chunk", 2) / "anyface.sh"
    for task, rows in ((1, "1-2"), (2, "3-4"), (3, "5-5")):
        environment = {"PATH": "/usr/bin:/bin", "SLURM_ARRAY_TASK_ID": str(task)}
        said = subprocess.run(
            ["bash", script], env=environment, capture_output=True, text=True, check=True
        ).stdout
        assert said.splitlines()[-2:] == ["--rows", rows]
    environment = {"PATH": "/usr/bin:/bin", "SLURM_ARRAY_TASK_ID": "0"}
    said = subprocess.run(
        ["bash", script, "sum"], env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert said.splitlines()[-1] == "--sum"


def header(script) -> dict[str, str]:
    """The options that Slurm reads from a script."""
    return dict(re.findall(r"^#SBATCH --([\w-]+)=(.*)$", script.read_text(), re.MULTILINE))


def test_needs_come_from_earlier_reports(farm):
    farm.write(45)
    farm.reports.mkdir()
    lines = [
        {"name": "a", "ok": True, "memory_mb": 1000.0, "seconds": 30.0},
        {"name": "b", "ok": False, "memory_mb": 2000.5, "seconds": 900.0},
        {"name": "c", "ok": True, "memory_mb": "much", "seconds": None},
    ]
    text = "\n".join(map(json.dumps, lines)) + '\n[1]\n{"name": "half'
    (farm.reports / "history.jsonl").write_text(text)
    read = header(farm.export("slurm") / "anyface.sh")
    # Memory: 2000.5 MB plus a quarter, rounded up to a multiple of 64. Time: 20 rows of four times
    # 30 s, plus 600 s to start.
    assert (read["mem"], read["cpus-per-task"]) == ("2560M", "2")
    assert (read["array"], read["time"]) == ("1-3", "0:3000")
    read = header(farm.export("slurm", "--memory", 6, "--cores", 8) / "anyface.sh")
    assert (read["mem"], read["cpus-per-task"]) == ("6144M", "8")
    read = header(farm.export("slurm", "--workers", 2, "--timeout", 60) / "anyface.sh")
    assert (read["mem"], read["cpus-per-task"], read["time"]) == ("5056M", "4", "0:1800")


def test_where_nothing_is_known_the_defaults_are_told(farm):
    farm.write(1)
    done = farm.batch("--export", "slurm")
    assert "1 rows, 20 a task, 4096 MB and 2 cores each" in done.stdout
    assert done.stdout.splitlines()[-1] == f"bash {farm.folder}/jobs.slurm/anyface.sh"
    assert not farm.reports.exists(), "an export does no shot and writes no report"


def test_a_row_that_cannot_be_right_is_told_and_counts(farm):
    farm.write(3)
    jobs = json.loads(farm.jobs.read_text())
    jobs["shots"][1] = {"object": "Head"}
    farm.jobs.write_text(json.dumps(jobs))
    done = farm.batch("--export", "flamenco")
    assert done.returncode == 0 and "shot 2" in done.stderr and "3 rows" in done.stdout
    settings = json.loads((farm.folder / "jobs.flamenco/job.json").read_text())["settings"]
    files = json.loads(settings["blendfiles"])
    assert settings["rows"] == 3 and [bool(file) for file in files] == [True, False, True]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--chunk", 0), "--chunk: expected 1 or more, got 0"),
        (("--cores", 0), "--cores: expected 1 or more, got 0"),
        (("--memory", -1), "--memory: expected more than 0 GB, got -1"),
        (("--again",), "delete their reports"),
        (("--scheduler", "tcp://a:1"), "expected --export or --scheduler"),
        (("--rows", "1-2"), "expected --export or --rows"),
        (("--dry-run",), "expected --export or --dry-run"),
        (("--workers", 0), "--workers: expected 1 or more, got 0"),
    ],
)
def test_what_makes_no_sense_is_refused(farm, words, said):
    farm.write(2)
    done = farm.batch("--export", "slurm", *words)
    assert done.returncode == 3 and said in done.stderr
    assert not (farm.folder / "jobs.slurm").exists()


def test_a_jobs_file_without_rows_is_refused(farm):
    farm.write(0)
    done = farm.batch("--export", "slurm")
    assert done.returncode == 3 and "expected rows to export, got none" in done.stderr


def test_open_job_description_has_no_way_to_write_two_braces(farm):
    farm.jobs = farm.folder / "a {{b}}.json"
    farm.write(2)
    done = farm.batch("--export", "openjd")
    assert done.returncode == 3 and "rename" in done.stderr


def test_an_unwritable_folder_is_an_error_of_files(farm):
    farm.write(2)
    (farm.folder / "file").touch()
    done = farm.batch("--export", "slurm", "--out", farm.folder / "file" / "folder")
    assert done.returncode == 8 and "file" in done.stderr


@pytest.mark.parametrize("engine", ENGINES)
def test_each_template_lists_what_is_filled_in(engine):
    for name in ENGINES[engine]:
        text = (TEMPLATES / name).read_text()
        used = set(re.findall(r"\{\{(\w+)\}\}", text))
        if name.endswith(".json"):
            continue
        words = re.sub(r"\([^)]*\)", "", re.search(r"fills in: ([^.]*)\.", text)[1])
        listed = set(re.findall(r"\w+", words.replace("#", "")))
        assert used == listed


@pytest.mark.parametrize("engine", ENGINES)
def test_nothing_is_left_to_fill_in(farm, engine):
    farm.write(2)
    for path in farm.export(engine).iterdir():
        left = re.findall(r"\{\{[\w.]+\}\}", path.read_text())
        openjd_braces = {"{{Param.Rows}}", "{{Param.RowsAtOnce}}", "{{Task.Param.Rows}}"}
        assert set(left) <= (openjd_braces if engine == "openjd" else set())
