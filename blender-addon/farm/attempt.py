"""Runs shots in a separate process.

Dask sends these functions, and those of `ledger` and `core` that they call, to other machines as
they are. There they need nothing but Python's own library.
"""

import contextlib
import json
import os
import subprocess
import threading
import time
from collections.abc import Iterator

from ..core import beside
from ..core.errors import plain
from .ledger import close, finished, forget, read

# A process prints this at the end of a line when its shot has ended.
END = "\x1eanyface: the shot has ended"
# Seconds between two checks of a running process.
_LOOK_S = 0.1
# Exit codes for a defect and for a lack of memory, as in `core.errors`. After these the next shot
# gets a new process.
_INTERNAL, _MEMORY = 10, 13
# SIGKILL. Not every system defines it by name.
_KILLED = 9


class ShotProcess:
    """A Blender process that does one shot after another and reads them from its standard input.

    It starts with its first shot and ends after `chunk` shots. `command` starts it; `threads` is
    the number of threads that it may use. Its input stays open as long as this process lives. If
    this process is killed, Blender reads the end of its input and stops too.
    """

    def __init__(self, command: list[str], threads: int | None = None, chunk: int = 1):
        self._command, self._threads, self._chunk = command, threads, chunk
        self._process, self._reader, self._shots = None, None, 0
        self._log, self._ended = None, threading.Event()

    def do(self, shot: dict, retries=1, timeout_s=None, stop=None) -> dict:
        """Does a `shot` (`asdict(Shot)`) and returns its report.

        A process that ends without a report has crashed; a new one tries again, up to `retries`
        times. `stop` is an event that ends it early. Nothing is raised: the report says what went
        wrong, and the other shots go on.
        """
        began = time.monotonic()
        try:
            outcome = self._outcome(shot, retries, timeout_s, stop)
            if outcome.get("name") is not None:
                return outcome
        except BaseException as raised:
            self.close()
            error = plain(raised)
            outcome = {"kind": error.kind, "message": str(error), "exit_code": error.exit_code}
        with contextlib.suppress(Exception):
            beside.remove_all(shot["save"])
        seconds = round(time.monotonic() - began, 3)
        return close(shot, {"ok": False, **outcome, "seconds": seconds})

    def close(self) -> None:
        """Ends the process; the next shot starts another one."""
        process, self._process, self._shots = self._process, None, 0
        if process is None:
            return
        process.kill()
        process.wait()
        with contextlib.suppress(OSError):
            process.stdin.close()
        self._reader.join(1.0)

    def _outcome(self, shot: dict, retries: int, timeout_s, stop) -> dict:
        """The report of a shot, or an outcome that says why there is none."""
        earlier = finished(shot)
        if earlier is not None:
            return earlier
        forget(shot)
        for _ in range(retries + 1):
            code, message = self._run(shot, timeout_s, stop)
            report = read(shot["report"])
            if report is not None:
                self._shots += 1
                if self._shots >= self._chunk or report.get("exit_code") in (_INTERNAL, _MEMORY):
                    self.close()
                return report
            self.close()
            if stop is not None and stop.is_set():
                break
        outcome = {"kind": "internal", "message": message, "process_code": code}
        return {**outcome, "exit_code": _INTERNAL}

    def _run(self, shot: dict, timeout_s, stop) -> tuple[int | None, str]:
        """The process's exit code, and the message for a process that leaves no report."""
        path = os.path.splitext(shot["report"])[0] + ".log"
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "ab") as self._log:
            try:
                why = self._start() or self._feed(shot, timeout_s, stop)
            finally:
                code = self._process.poll() if self._process is not None else None
                if code is not None:
                    # The process has ended: read the rest of its output.
                    self._reader.join(1.0)
                self._log = None
        return code, why or _ending(code, path)

    def _start(self) -> str:
        """Starts the process if none is running; returns the reason if it cannot, else ""."""
        if self._process is not None and self._process.poll() is None:
            return ""
        self.close()
        environment = dict(os.environ)
        if self._threads:
            # numpy's threads spin while they wait, which takes the cores from other processes.
            for name in ("RAYON_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
                environment.setdefault(name, str(self._threads))
        try:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env=environment,
            )
        except OSError as error:
            program = self._command[0]
            return f"{program}: {error.strerror}: check --blender, and that it may be run"
        self._reader = threading.Thread(target=self._listen, args=(self._process,), daemon=True)
        self._reader.start()
        return ""

    def _listen(self, process) -> None:
        """Writes the output of a process into the log of its shot."""
        try:
            for line in process.stdout:
                self._hear(line)
        except Exception:
            # Without this thread nobody would notice the end of the shot.
            process.kill()
            raise
        finally:
            process.stdout.close()

    def _hear(self, line: bytes) -> None:
        log, has_ended = self._log, line.rstrip().endswith(END.encode())
        # Blender may have printed something at the start of the same line.
        line = line.replace(END.encode(), b"").lstrip() if has_ended else line
        if log is not None and line:
            # The log may have been closed meanwhile, or the disk may be full.
            with contextlib.suppress(OSError, ValueError):
                log.write(line)
                log.flush()
        if has_ended:
            self._ended.set()

    def _feed(self, shot: dict, timeout_s, stop) -> str:
        """Gives the process the shot and waits; returns the reason if it was stopped, else ""."""
        last = time.monotonic() + (timeout_s or float("inf"))
        self._ended.clear()
        with contextlib.suppress(OSError):
            self._process.stdin.write(json.dumps(shot).encode() + b"\n")
            self._process.stdin.flush()
        while not self._ended.wait(_LOOK_S) and self._process.poll() is None:
            if time.monotonic() > last:
                self._process.kill()
                self._process.wait()
                return f"took longer than {timeout_s:g} s and was stopped: raise --timeout"
            if stop is not None and stop.is_set():
                self._process.kill()
                self._process.wait()
                return "stopped: run the batch again to go on"
        return ""


def run_shots(command: list[str], shots: list[dict], **limits) -> Iterator[dict]:
    """Yields the reports of `shots`, which one process does one after another.

    `limits` are passed to `ShotProcess.do`.
    """
    with contextlib.closing(ShotProcess(command, chunk=len(shots))) as process:
        for shot in shots:
            yield process.do(shot, **limits)


def _ending(code: int | None, log: str) -> str:
    """The message for a process that ended without a report: how it ended and where to look."""
    if code == -_KILLED:
        return (
            f"the process was killed, most often by a system that is out of memory: run fewer "
            f"--workers, and see {log}"
        )
    if code is None:
        return f"the shot left no report: see {log} and that {os.path.dirname(log)} may be written"
    return f"the process ended early ({code}): see {log}, then run the batch again"
