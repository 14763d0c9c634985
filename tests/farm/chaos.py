"""Kills processes of a running batch again and again, and counts what became of the rows.

    python tests/farm/chaos.py slurm --extension target/extension --rows 1000 --kills 100
    python tests/farm/chaos.py local --extension target/extension --rows 1000 --kills 100

`slurm` runs the exported array job on three hosts. It kills the controller, whole hosts, and
processes that do shots. `local` runs a pool on this machine. It kills the batch itself and
processes that do shots. A stand-in for Blender does the shots (stage_blender.py): it waits, and
writes files, reports and history with the code that Blender runs. At the end the batch is started
once more, as its message asks.
"""

import argparse
import collections
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import conftest
import slurm

_NODES, _CORES, _WORKERS, _CHUNK = 3, 2, 4, 10
_LIMIT_S = 1800


def main() -> int:
    """Runs one trial; returns 0 if no row is lost or failed and no file is half written."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("engine", choices=("slurm", "local"))
    parser.add_argument("--extension", type=Path, required=True, help="its folder")
    parser.add_argument("--rows", type=int, default=1000)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--every", type=float, default=2.0, metavar="S", help="between two kills")
    parser.add_argument("--seconds", type=float, default=1.0, help="of one shot")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="anyface-chaos-") as folder:
        farm = conftest.Farm(Path(folder), options.extension.resolve())
        farm.write(options.rows)
        trial = {"slurm": OnSlurm, "local": OnLocalPool}[options.engine](farm, options.seconds)
        return run(trial, farm, options)


def run(trial, farm, options) -> int:
    """Kills until `--kills` is reached or the batch ends, runs it once more, prints the counts."""
    chance, kills = random.Random(options.seed), collections.Counter()
    began = time.monotonic()
    try:
        trial.start()
        while sum(kills.values()) < options.kills and not trial.ended():
            time.sleep(chance.uniform(0.5, 1.5) * options.every)
            kind = chance.choices(list(trial.kinds), list(trial.kinds.values()))[0]
            kills[kind] += trial.kill(kind, chance)
        print(f"kills: {dict(kills)}, after {time.monotonic() - began:.0f} s", flush=True)
        trial.wait()
        first = count(farm, options.rows)
        print(f"after the first run: {first}, {trial.released} jobs released", flush=True)
        trial.start()
        trial.wait()
    finally:
        trial.close()
    last = count(farm, options.rows)
    print(f"after the second run: {last}, {time.monotonic() - began:.0f} s")
    print("left:", *hidden_files(farm))
    return 1 if last["lost"] or last["failed"] or last["half written"] else 0


def count(farm, rows: int) -> dict[str, int]:
    """Counts what became of the rows.

    A `lost` row has no report. The report of a `failed` row says why it failed. A row that is
    `twice in the history` has several lines there that are ok. The file of a row that is `written
    twice` was written several times. `half written` are incomplete results and reports. `hidden
    files left` are the temporary files of killed processes.
    """
    reports = {name: farm.reports / f"{name}.json" for name in farm.names(rows)}
    states = {name: load(path.read_text()) for name, path in reports.items() if path.exists()}
    lines = [load(line) for line in (farm.reports / "history.jsonl").read_text().splitlines()]
    ok = collections.Counter(line["name"] for line in lines if line and line["ok"])
    results = [path for path in (farm.folder / "out").iterdir() if path.name[0] != "."]
    half = sum(not is_whole(path) for path in results) + list(states.values()).count(None)
    return {
        "ok": sum(bool(state and state["ok"]) for state in states.values()),
        "failed": sum(bool(state and not state["ok"]) for state in states.values()),
        "lost": rows - len(states),
        "twice in the history": sum(times > 1 for times in ok.values()),
        "written twice": sum(times > 1 for times in farm.written().values()),
        "half written": half,
        "hidden files left": len(hidden_files(farm)),
        "torn lines": lines.count(None),
    }


def hidden_files(farm) -> list[str]:
    """The temporary files that killed processes have left."""
    names = [
        path.name for folder in ("out", farm.reports) for path in (farm.folder / folder).iterdir()
    ]
    return [name for name in names if name[0] == "."]


def load(text: str) -> dict | None:
    """The value of a JSON text; None if the text is incomplete."""
    try:
        return json.loads(text)
    except ValueError:
        return None


def is_whole(path: Path) -> bool:
    """Whether the file is a complete result."""
    name = path.stem
    return path.read_text() == f"{name} begins\n{name} ends\n"


def kill_one_shot(farm, chance: random.Random) -> int:
    """Kills one of the processes that do shots; returns how many, 0 or 1."""
    mark, running = str(farm.blender).encode(), []
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            if entry.name.isdigit():
                words = (entry / "cmdline").read_bytes().split(b"\0")
                by = (entry / "environ").read_bytes()
                if b"shot" in words and b"ANYFACE_TEST_BLENDER=" + mark in by:
                    running.append(int(entry.name))
    if not running:
        return 0
    with suppress(ProcessLookupError):
        os.kill(chance.choice(running), signal.SIGKILL)
        return 1
    return 0


class OnSlurm:
    """The exported array job on three hosts."""

    kinds = {"controller": 1, "host": 1, "shot": 2}  # noqa: RUF012

    def __init__(self, farm, seconds: float):
        reason = slurm.missing()
        if reason:
            sys.exit(reason)
        self._farm, self.released = farm, 0
        words = ("--chunk", _CHUNK, "--cores", 1, "--memory", 0.5)
        self._script = farm.export("slurm", *words) / "anyface.sh"
        folder = farm.folder / "slurm"
        folder.mkdir()
        self._slurm = slurm.Slurm(folder, _NODES, farm.environment(seconds), _CORES)

    def start(self):
        """Submits the array job."""
        self._slurm.run("bash", self._script)

    def ended(self) -> bool:
        """Whether no job is left."""
        return not self._slurm.queue()

    def kill(self, kind: str, chance: random.Random) -> int:
        """Kills a shot, or kills and restarts the controller or a host; returns the count."""
        if kind == "shot":
            return kill_one_shot(self._farm, chance)
        if kind == "controller":
            self._slurm.kill_control()
            time.sleep(chance.uniform(0.0, 2.0))
            self._slurm.start_control()
        else:
            node = chance.choice(self._slurm.nodes)
            self._slurm.kill_node(node)
            # On a real farm an operator tells Slurm this. Slurm itself notices it only later.
            self._slurm.run("scontrol", "update", f"nodename={node}", "state=down", "reason=chaos")
            self._slurm.boot_node(node)
        self._slurm.wait_control()
        self.released += self._slurm.mend()
        return 1

    def wait(self):
        """Waits for the end of the array, and releases the jobs that Slurm holds."""
        last = time.monotonic() + _LIMIT_S
        while self._slurm.queue():
            if time.monotonic() > last:
                raise TimeoutError(f"jobs are left: {self._slurm.queue()}")
            self.released += self._slurm.mend()
            time.sleep(2.0)

    def close(self):
        """Ends all hosts."""
        self._slurm.close()


class OnLocalPool:
    """A pool of processes on this machine. A killed batch is started again."""

    kinds = {"batch": 1, "shot": 2}  # noqa: RUF012

    def __init__(self, farm, seconds: float):
        self._farm, self._seconds, self._process, self.released = farm, seconds, None, 0

    def start(self):
        """Starts the batch."""
        farm = self._farm
        command = [sys.executable, farm.extension / "anyface_batch.py", "batch", farm.jobs]
        words = ("--blender", farm.blender, "--workers", _WORKERS)
        self._process = subprocess.Popen(
            [*map(str, command), *map(str, words)],
            env={**os.environ, **farm.environment(self._seconds)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def ended(self) -> bool:
        """Whether the batch has ended by itself."""
        return self._process.poll() is not None

    def kill(self, kind: str, chance: random.Random) -> int:
        """Kills the batch and starts it again, or kills a process that does a shot."""
        if kind == "shot":
            return kill_one_shot(self._farm, chance)
        self._process.kill()
        self._process.wait()
        self.start()
        return 1

    def wait(self):
        """Waits for the end of the batch."""
        self._process.wait(_LIMIT_S)

    def close(self):
        """Ends the batch."""
        self._process.kill()
        self._process.wait()


if __name__ == "__main__":
    sys.exit(main())
