"""Measures what `anyface animate` costs as a process, and how close its proxy of a mesh comes to the mesh.

    python -m training.benchmarks.animate --anyface target/release/anyface --out runs/animate

The head is ICT FaceKit's with all its parts, 26,719 vertices, and the same with every triangle cut in four,
twice. `--out` keeps them as OBJ, for `cargo measure bench`. The speech is the first 5 s of a recording.
Prints the tables of docs/measured/speed.md. Needs Linux, and nothing else may run beside it.
"""

import os
import statistics
import subprocess
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import soundfile
from safetensors.numpy import load_file

from training import DATA
from training.corpus.remesh import quartered
from training.corpus.topology import write_obj
from training.engine import Engine
from training.flags import run_command

CM, MM = 0.01, 1000.0
SPEECH_S = 5.0
CUTS = (0, 2)
RUNS = 3
SHARES = (50, 95, 99, 100)


@dataclass
class Cost:
    """What one process took."""

    wall_s: float
    processor_s: float
    memory_mib: float


def write_heads(data: Path, out: Path) -> dict[int, Path]:
    """Writes the head in metres for each number of cuts. Returns paths by number of vertices."""
    head = load_file(data / "faces/ict_facekit.safetensors")
    points, triangles = CM * head["neutral"].astype(np.float64), head["triangles"].astype(np.int64)
    paths = {}
    for cuts in range(max(CUTS) + 1):
        if cuts:
            grow, triangles = quartered(triangles, len(points))
            points = grow @ points
        if cuts in CUTS:
            paths[len(points)] = out / f"head_{cuts}.obj"
            write_obj(paths[len(points)], points, triangles)
    return paths


def run(command: list, cache: Path) -> Cost:
    """Runs a command to its end."""
    began = time.perf_counter()
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    child = subprocess.Popen(list(map(str, command)), env=environment, **quiet)
    memory_mib = 0.0
    # The peak that wait4 reports counts this process too, of which the child was a copy for a moment.
    while not (ended := os.wait4(child.pid, os.WNOHANG))[0]:
        memory_mib = max(memory_mib, peak_mib(child.pid))
        time.sleep(0.005)
    wall_s, (_, status, usage) = time.perf_counter() - began, ended
    if status:
        raise RuntimeError(f"{command}: status {status}")
    return Cost(wall_s, usage.ru_utime + usage.ru_stime, memory_mib)


def peak_mib(pid: int) -> float:
    """The largest memory of a process so far. 0 after its end."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return 0.0


def median(costs: list[Cost]) -> str:
    """Three cells of a table."""
    values = [
        statistics.median(column) for column in zip(*(vars(cost).values() for cost in costs), strict=True)
    ]
    return f"{values[0]:.2f} | {values[1]:.2f} | {values[2]:.0f}"


def print_costs(binary: Path, heads: dict[int, Path], sound: Path, folder: Path) -> None:
    """Medians of new meshes, each with a cache of its own, and of a mesh that is in the cache."""
    print("| vertices | | wall s | processor s | memory MiB |\n| --- | --- | --- | --- | --- |")
    for vertices, mesh in heads.items():
        job = [binary, "animate", "--mesh", mesh, "--audio", sound, "--out", folder / "out.npz"]
        new = [run(job, folder / f"cache_{vertices}_{number}") for number in range(RUNS)]
        known = [run(job, folder / f"cache_{vertices}_0") for _ in range(RUNS)]
        print(f"| {vertices:,} | new mesh | {median(new)} |")
        print(f"| {vertices:,} | seen before | {median(known)} |")


def print_proxy(binary: Path, heads: dict[int, Path], sound: Path) -> None:
    """Distances between the motion of the default proxy and that of every vertex, mm."""
    print(f"| vertices | {' | '.join(f'{share} %' for share in SHARES)} |\n|{' --- |' * (len(SHARES) + 1)}")
    for vertices, mesh in heads.items():
        job = ("animate", "--mesh", mesh, "--audio", sound, "--no-cache")
        proxy, full = (Engine(binary).run(*job, *more)["displacements"] for more in ((), ("--proxy", "off")))
        apart = MM * np.linalg.norm(proxy - full, axis=2)
        print(f"| {vertices:,} | {' | '.join(f'{value:.3f}' for value in np.percentile(apart, SHARES))} |")


def main(
    anyface: Annotated[Path, "the command"] = Path("target/release/anyface"),
    data: Path = DATA,
    out: Annotated[Path, "folder for the heads"] = Path("runs/animate"),
) -> None:
    """Prints both tables."""
    out.mkdir(parents=True, exist_ok=True)
    heads = write_heads(data, out)
    samples, rate = soundfile.read(data / "clips/jfk.wav", dtype="float32")
    soundfile.write(out / "speech.wav", samples[: int(SPEECH_S * rate)], rate)
    with tempfile.TemporaryDirectory() as folder:
        print_costs(anyface.resolve(), heads, out / "speech.wav", Path(folder))
    smallest = min(heads)
    print_proxy(anyface.resolve(), {smallest: heads[smallest]}, out / "speech.wav")


if __name__ == "__main__":
    run_command(main)
