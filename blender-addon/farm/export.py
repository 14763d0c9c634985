"""Prepares the rows of a jobs file for a farm's engine, which then runs them.

It fills in templates and says what to type next.

The templates lie in the folder `engines` of the extension, which is `cli/farm` in the repository.
Each template lists its placeholders at its top. Nothing here runs a shot.
"""

import json
import re
import shlex
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..core import json_file
from ..core.errors import AnyfaceError
from . import jobs, ledger, receipts
from .paths import PathMap

# A bake of 4 s on the default head (8,510 vertices) takes 0.45 GB in Blender 5.0. Film scenes are
# far larger.
DEFAULT_MEMORY_MB = 4096
DEFAULT_CORES = 2
# Assumed for a shot if there are no earlier reports.
_DEFAULT_SHOT_S = 600
# The time that Blender takes to start from a slow disk.
_START_S = 600
_MEMORY_MARGIN, _TIME_MARGIN = 1.25, 4
_PLACEHOLDER = re.compile(r"\{\{(\w+)\}\}")
_NOT_OF_NAMES = re.compile(r"[^A-Za-z0-9_.-]+")


@dataclass(frozen=True)
class NodeCommand:
    """The command that a node runs: `program before jobs options --rows A-B`."""

    program: str
    before: tuple[str, ...]
    jobs: str
    options: tuple[str, ...]

    @property
    def arguments(self) -> tuple[str, ...]:
        """All words after the program."""
        return (*self.before, self.jobs, *self.options)


@dataclass(frozen=True)
class Engine:
    """A farm engine: the file that each template becomes, and what to type afterwards."""

    files: dict[str, str]
    hint: str


ENGINES = {
    "flamenco": Engine(
        {"flamenco.js": "anyface.js", "flamenco.json": "job.json"},
        "copy {folder}/anyface.js into the folder scripts of flamenco-manager (once), then run\n"
        "curl -H 'Content-Type: application/json' -d @{folder}/job.json "
        "http://MANAGER:8080/api/v3/jobs",
    ),
    "openjd": Engine({"openjd.yaml": "template.yaml"}, "deadline bundle submit {folder}"),
    "slurm": Engine({"slurm.sh": "anyface.sh"}, "bash {folder}/anyface.sh"),
    "opencue": Engine({"opencue.py": "submit.py"}, "python {folder}/submit.py"),
}


@dataclass(frozen=True)
class Needs:
    """What a task needs: memory, cores, and the seconds after which it may be ended."""

    memory_mb: int
    cores: int
    seconds: int


def saves(path: Path, paths: PathMap, listed: jobs.Listed) -> list[str]:
    """The file that each row of a jobs file writes, "" for an invalid row."""
    content, right = json_file.read(path), {shot.save for shot in listed.shots}
    files = []
    for row in content["shots"]:
        save = {**content.get("defaults", {}), **row}.get("save") if isinstance(row, dict) else None
        file = str(path.parent / paths.here(save)) if isinstance(save, str) else ""
        files.append(file if file in right else "")
    return files


def run(options, command: NodeCommand, saves: list[str], reports: Path) -> str:
    """Writes the files of `options.export`; returns what to type next.

    `saves` is the result of the function `saves`. `options` has `export`, `out`, `chunk`, `memory`
    (GB), `cores`, `workers` and `timeout` from the command line. Raises `AnyfaceError`.
    """
    engine = options.export
    if not saves:
        raise AnyfaceError("input", f"{command.jobs}: expected rows to export, got none")
    _check(options)
    if engine == "openjd" and any("{{" in word for word in (command.program, *command.arguments)):
        raise AnyfaceError(
            "input",
            "Open Job Description takes '{{' for its own: expected paths without it, rename them",
        )
    beside = Path(command.jobs).with_suffix(f".{engine}")
    folder = Path(options.out).resolve() if options.out else beside
    needs = measure(reports, options)
    values = _values(engine, command, saves, options.chunk, needs)
    files = {folder / name: template for template, name in ENGINES[engine].files.items()}
    receipts.check(*files)
    for path, template in files.items():
        text = (templates() / template).read_text("utf-8")
        receipts.write(path, fill(text, values))
    typed = ENGINES[engine].hint.replace("{folder}", shlex.quote(str(folder)))
    return (
        f"{len(saves)} rows, {options.chunk} a task, {needs.memory_mb} MB and {needs.cores} cores "
        f"each, in {folder}; now\n{typed}"
    )


def measure(reports: Path, options) -> Needs:
    """What a task needs, estimated from earlier shots; defaults if there are none."""
    memory_mb, seconds = 0.0, 0.0
    for report in _history(reports):
        memory_mb = max(memory_mb, _real(report.get("memory_mb")))
        if report.get("ok"):
            seconds = max(seconds, _real(report.get("seconds")))
    memory_mb = memory_mb * _MEMORY_MARGIN or DEFAULT_MEMORY_MB
    if options.memory:
        memory_mb = options.memory * 1024
    else:
        memory_mb *= options.workers
    shot_s = options.timeout or seconds * _TIME_MARGIN or _DEFAULT_SHOT_S
    cores = options.cores or DEFAULT_CORES * options.workers
    return Needs(_up(memory_mb, 64), cores, _up(_START_S + shot_s * options.chunk, 60))


def fill(template: str, values: dict[str, str]) -> str:
    """Replaces each `{{name}}` by `values["name"]`, in one pass; other braces stay."""
    return _PLACEHOLDER.sub(lambda match: values.get(match[1], match[0]), template)


def _values(engine: str, command: NodeCommand, saves, chunk: int, needs: Needs) -> dict[str, str]:
    """The texts for the placeholders, quoted as the engine's language needs it."""
    if engine == "slurm":
        program, arguments = shlex.quote(command.program), shlex.join(command.arguments)
    else:
        program, arguments = _json(command.program), ", ".join(map(_json, command.arguments))
    # Flamenco replaces its variable {blender} itself, so it must not be quoted for a shell.
    start = shlex.join([command.program, *command.before]).replace("'{blender}'", "{blender}")
    values = {
        "name": _NOT_OF_NAMES.sub("-", Path(command.jobs).stem).strip("-") or "anyface",
        "program": program,
        "arguments": arguments,
        "rows": len(saves),
        "chunk": chunk,
        "chunks": -(-len(saves) // chunk),
        "memory_mb": needs.memory_mb,
        "cores": needs.cores,
        "seconds": needs.seconds,
        "command": _json(start),
        "jobs": _json(command.jobs),
        "options": _json(shlex.join(command.options)),
        "blendfiles": _json(_json(saves)),
        "platform": {"win32": "windows"}.get(sys.platform, sys.platform),
    }
    return {name: str(value) for name, value in values.items()}


def _check(options) -> None:
    if options.cores is not None and options.cores < 1:
        raise AnyfaceError("input", f"--cores: expected 1 or more, got {options.cores}")
    if options.memory is not None and options.memory <= 0:
        raise AnyfaceError("input", f"--memory: expected more than 0 GB, got {options.memory:g}")
    for name in ("scheduler", "rows", "sum", "dry_run"):
        if getattr(options, name):
            word = name.replace("_", "-")
            raise AnyfaceError("input", f"expected --export or --{word}, got both")
    if options.again:
        raise AnyfaceError(
            "input",
            "--again: a task that is queued again would do finished shots again: delete their "
            "reports instead",
        )


def _history(reports: Path):
    """Yields the readable lines of the history; a killed node may have left half a line."""
    with suppress(OSError), open(reports / ledger.HISTORY, encoding="utf-8") as file:
        for line in file:
            with suppress(ValueError):
                report = json_file.parse(line)
                if isinstance(report, dict):
                    yield report


def _real(value) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _up(value: float, step: int) -> int:
    return int(-(-value // step) * step)


def _json(value) -> str:
    return json.dumps(value, ensure_ascii=False)


def templates() -> Path:
    """The folder of templates: beside this file in the extension, `cli/farm` in the repository."""
    here = Path(__file__).resolve().parent
    packed = here / "engines"
    return packed if packed.is_dir() else here.parents[1] / "cli" / "farm"
