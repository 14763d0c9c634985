"""One shot in a process of its own.

These functions, and those of `ledger` and `core` that they call, are sent to other
machines as they are: they need nothing but Python's own library there.
"""

import contextlib
import json
import os
import subprocess
import time

from ..core import beside
from ..core.errors import plain
from .ledger import close, finished, forget, read

# Seconds between two looks at a running process.
_LOOK_S = 0.1
# The exit code of a defect, as `core.errors` has it.
_INTERNAL = 10
# SIGKILL, which not every system has by name.
_KILLED = 9


def run_shot(command, shot, threads=None, retries=1, timeout_s=None, stop=None) -> dict:
    """Runs `command` with `shot` (`asdict(Shot)`) on its standard input; returns the report.

    A process that ends without a report has crashed; it is tried again up to `retries` times.
    `threads` is what the process may use; `stop` is an event that ends it early. Nothing is raised:
    whatever goes wrong stands in the report, and the other shots go on.
    """
    began = time.monotonic()
    try:
        outcome = _outcome(command, shot, threads, retries, timeout_s, stop)
        if outcome.get("name") is not None:
            return outcome
    except BaseException as raised:
        error = plain(raised)
        outcome = {"kind": error.kind, "message": str(error), "exit_code": error.exit_code}
    with contextlib.suppress(Exception):
        beside.remove_all(shot["save"])
    seconds = round(time.monotonic() - began, 3)
    return close(shot, {"ok": False, **outcome, "seconds": seconds})


def _outcome(command, shot, threads, retries, timeout_s, stop) -> dict:
    """The report of a shot, or why there is none."""
    done = finished(shot)
    if done is not None:
        return done
    forget(shot)
    for _ in range(retries + 1):
        code, message = _run(command, shot, threads, timeout_s, stop)
        told = read(shot["report"])
        if told is not None:
            return told
        if stop is not None and stop.is_set():
            break
    outcome = {"kind": "internal", "message": message, "process_code": code}
    return {**outcome, "exit_code": _INTERNAL}


def _run(command, shot, threads, timeout_s, stop) -> tuple[int | None, str]:
    """Exit code of one process, and what to say where it leaves no report."""
    log = os.path.splitext(shot["report"])[0] + ".log"
    os.makedirs(os.path.dirname(log), exist_ok=True)
    environment = dict(os.environ)
    if threads:
        environment.setdefault("RAYON_NUM_THREADS", str(threads))
    with open(log, "ab") as output:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
            )
        except OSError as error:
            return None, f"{command[0]}: {error.strerror}: check --blender, and that it may be run"
    late = _feed(process, shot, timeout_s, stop)
    if late:
        return process.returncode, late
    return process.returncode, _ending(process.returncode, log)


def _ending(code: int, log: str) -> str:
    """How a process without a report has ended, and where to look."""
    if code == -_KILLED:
        return (
            f"the process was killed, most often by a system that is out of memory: run fewer "
            f"--workers, and see {log}"
        )
    return f"the process ended early ({code}): see {log}, then run the batch again"


def _feed(process, shot, timeout_s, stop) -> str:
    """Gives the shot to the process and waits; says why where it had to be stopped.

    The pipe stays open as long as this process lives: where it is killed, the other one reads the
    end of its input, and stops too.
    """
    last = time.monotonic() + (timeout_s or float("inf"))
    try:
        process.stdin.write(json.dumps(shot).encode() + b"\n")
        process.stdin.flush()
        while process.poll() is None:
            if time.monotonic() > last:
                return f"took longer than {timeout_s:g} s and was stopped: raise --timeout"
            if stop is not None and stop.is_set():
                return "stopped: run the batch again to go on"
            time.sleep(_LOOK_S)
    except OSError:
        # It has ended, or reads no more.
        process.wait()
    finally:
        process.kill()
        process.wait()
        with contextlib.suppress(OSError):
            process.stdin.close()
    return ""
