"""Measures how many lines of speech `anyface batch` does per second, and its memory.

`python tests/batch/bench_lines.py --command target/demo/anyface --lines 10000` makes a head of
26,719 vertices and lines of 4 s from `../shared/data`. The command writes a table of ARKit
weights for each line. The script prints lines per second, processor time per line, and the resident
memory after some of the lines, which shows whether it stays flat. docs/measured/speed.md has the
numbers.
The script needs only Python, and Linux.
"""

import argparse
import array
import json
import os
import struct
import subprocess
import tempfile
import time
import wave
from pathlib import Path

SHARED = Path(os.environ.get("ANYFACE_SHARED", Path(__file__).resolve().parents[3] / "shared"))
RATE_HZ = 16_000
# The number of different sounds. Further lines repeat them with other seeds.
SOUNDS = 400


def write_head(path: Path) -> None:
    """Writes ICT FaceKit's neutral head in metres, and a file with its landmarks beside it."""
    content = (SHARED / "data/faces/ict_facekit.safetensors").read_bytes()
    size = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + size])

    def values(name: str) -> array.array:
        begin, end = header[name]["data_offsets"]
        kind = {"F32": "f", "I32": "i", "U32": "I", "I64": "q"}[header[name]["dtype"]]
        return array.array(kind, content[8 + size + begin : 8 + size + end])

    points, corners = values("neutral"), values("triangles")
    with path.open("w", encoding="utf-8") as file:
        for at in range(0, len(points), 3):
            file.write("v {:.6f} {:.6f} {:.6f}\n".format(*(0.01 * x for x in points[at : at + 3])))
        for at in range(0, len(corners), 3):
            file.write("f {} {} {}\n".format(*(v + 1 for v in corners[at : at + 3])))
    path.with_suffix(".landmarks.json").write_text(json.dumps(list(values("landmarks68"))))


def write_sounds(folder: Path, count: int, seconds: float) -> list[str]:
    """Cuts `count` excerpts, spread over the recordings of `clips`; returns their file names."""
    length = int(seconds * RATE_HZ)
    voices = []
    for path in sorted((SHARED / "data/clips").rglob("*.wav")):
        with wave.open(str(path)) as sound:
            is_usable = (sound.getframerate(), sound.getnchannels()) == (RATE_HZ, 1)
            if is_usable and sound.getnframes() > length:
                voices.append(sound.readframes(sound.getnframes()))
    names = []
    for number in range(count):
        voice = voices[number % len(voices)]
        room = len(voice) // 2 - length
        start = room * (number // len(voices)) // max(1, count // len(voices))
        names.append(f"{number:04}.wav")
        with wave.open(str(folder / names[-1]), "wb") as sound:
            sound.setnchannels(1)
            sound.setsampwidth(2)
            sound.setframerate(RATE_HZ)
            sound.writeframes(voice[2 * start : 2 * (start + length)])
    return names


def resident_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return 0.0


def run(options: argparse.Namespace, folder: Path) -> None:
    write_head(folder / "head.obj")
    sounds = write_sounds(folder, min(SOUNDS, options.lines), options.seconds)
    with (folder / "lines.csv").open("w", encoding="utf-8") as file:
        file.write("audio,out,seed\n")
        for number in range(options.lines):
            file.write(f"{sounds[number % len(sounds)]},out{number:05}.{options.ending},{number}\n")
    command = [options.command, "batch", "lines.csv", "--mesh", "head.obj", *options.more]
    started = time.monotonic()
    history = folder / "lines.reports/history.jsonl"
    process = subprocess.Popen(command, cwd=folder)
    marks = [mark for mark in (100, 1000, 2000, 5000, options.lines - 20) if mark <= options.lines]
    while process.poll() is None:
        done = 0
        if history.exists():
            with history.open("rb") as file:
                done = sum(1 for _ in file)
        if marks and done >= marks[0]:
            seconds = time.monotonic() - started
            print(f"{done} lines, {seconds:.0f} s: {resident_mb(process.pid):.0f} MB", flush=True)
            marks.pop(0)
        time.sleep(1.0 if options.lines > 500 else 0.1)
    seconds = time.monotonic() - started
    used = os.times()
    processor = used.children_user + used.children_system
    print(
        f"{options.lines} lines in {seconds:.1f} s, {options.lines / seconds:.2f} a second; "
        f"{1e3 * processor / options.lines:.1f} ms of processor time a line; "
        f"exit {process.returncode}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--command", type=os.path.abspath, default="target/release/anyface")
    parser.add_argument("--lines", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=4.0, help="length of a line")
    parser.add_argument("--ending", default="csv", help="what each line is written as")
    parser.add_argument("--folder", type=Path, help="work here, and leave it")
    parser.add_argument("more", nargs="*", help="further options of `anyface batch`, after --")
    options = parser.parse_args()
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
        run(options, options.folder)
        return
    with tempfile.TemporaryDirectory() as folder:
        run(options, Path(folder))


if __name__ == "__main__":
    main()
