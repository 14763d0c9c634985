"""Stands in for Blender on a farm: `blender -b --command anyface TASK …`, without bpy.

`batch` is the extension's real one, with this program as its Blender. `shot` takes
`ANYFACE_TEST_S` seconds for each shot instead of animating a face. It writes files and reports as
Blender does: under a temporary name in the same folder, and then it renames them.
`ANYFACE_TEST_EXTENSION` is the folder of the unpacked extension.
"""

import importlib
import json
import os
import queue
import sys
import threading
import time
import types
from pathlib import Path

EXTENSION = Path(os.environ["ANYFACE_TEST_EXTENSION"])
_PACKAGE = "anyface_on_stage"
_ORPHANED = 70


def main() -> int:
    """Runs the task; returns its exit code."""
    words = sys.argv[1:]
    words = words[words.index("anyface") + 1 :]
    if words[0] == "batch":
        sys.path.insert(0, str(EXTENSION))
        blender = os.environ.get("ANYFACE_TEST_BLENDER", sys.argv[0])
        return importlib.import_module("anyface_batch").main([*words, "--blender", blender])
    package = types.ModuleType(_PACKAGE)
    package.__path__ = [str(EXTENSION)]
    sys.modules[_PACKAGE] = package
    end = importlib.import_module(f"{_PACKAGE}.farm.attempt").END
    lines = queue.SimpleQueue()
    threading.Thread(target=_read, args=(lines,), daemon=True).start()
    while line := lines.get():
        _do(json.loads(line))
        print(end, flush=True)
    return 0


def _read(lines: queue.SimpleQueue) -> None:
    rest = b""
    while part := os.read(sys.stdin.fileno(), 1 << 16):
        *whole, rest = (rest + part).split(b"\n")
        for line in whole:
            lines.put(line)
    # The process that gave this work is gone, and the work is done elsewhere.
    os._exit(_ORPHANED)


def _do(shot: dict) -> None:
    ledger = importlib.import_module(f"{_PACKAGE}.farm.ledger")
    with ledger.claim(shot):
        if ledger.finished(shot) is None:
            ledger.clear(shot)
            _write(shot, ledger)


def _write(shot: dict, ledger) -> None:
    beside = importlib.import_module(f"{_PACKAGE}.core.beside")
    beside.remove_all(shot["save"])
    began = time.monotonic()
    os.makedirs(os.path.dirname(shot["save"]), exist_ok=True)
    half = beside.name(shot["save"])
    with open(half, "w", encoding="utf-8") as file:
        file.write(f"{shot['name']} begins\n")
        file.flush()
        time.sleep(float(os.environ.get("ANYFACE_TEST_S", "0.1")))
        file.write(f"{shot['name']} ends\n")
        file.flush()
        os.fsync(file.fileno())
    os.replace(half, shot["save"])
    _note(shot)
    seconds = round(time.monotonic() - began, 3)
    ledger.close(shot, {"ok": True, "message": "done", "exit_code": 0, "seconds": seconds})


def _note(shot: dict) -> None:
    """Adds a line for a file that was really written. A single write keeps the line whole."""
    line = f"{shot['name']} {os.uname().nodename} {os.getpid()}\n"
    path = os.path.join(os.path.dirname(shot["report"]), "written.txt")
    note = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    os.write(note, line.encode())
    os.close(note)


if __name__ == "__main__":
    sys.exit(main())
