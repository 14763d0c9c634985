"""Reports on disk: one JSON file for each shot, and one history of all tries."""

import contextlib
import errno
import glob
import hashlib
import json
import os
import socket
import time

from ..core.errors import AnyfaceError
from ..core.json_file import read as read_json
from ..core.json_file import write as write_json

try:
    import fcntl
except ImportError:
    # Windows has no fcntl and locks files with msvcrt.
    import msvcrt

    fcntl = None

# The file beside the reports that gets a line whenever a shot ends.
HISTORY = "history.jsonl"
# The file beside the history in which a process locks one byte for each shot that it does.
CLAIMS = ".claims"
_PAUSE_S = 0.1


def read(report: str) -> dict | None:
    """A report, or None if the file is missing, unreadable or not one of our reports."""
    try:
        content = read_json(report)
    except AnyfaceError:
        return None
    is_ours = isinstance(content, dict) and {"name", "ok", "message"} <= content.keys()
    return content if is_ours else None


def check(shots: list[dict]) -> None:
    """Raises `AnyfaceError("file")` if something else has the name of a report."""
    for path in (shot["report"] for shot in shots):
        if os.path.lexists(path) and (os.path.islink(path) or read(path) is None):
            text = f"{path}: expected the report of a shot, got another file: move it away"
            raise AnyfaceError("file", text)


def finished(shot: dict) -> dict | None:
    """The report of a shot (`asdict(Shot)`) if it is finished, else None.

    It is finished if it succeeded with the same digest and its saved file exists.
    """
    report = read(shot["report"])
    if report is None or not report.get("ok") or report.get("digest") != shot["digest"]:
        return None
    return report if os.path.isfile(shot["save"]) else None


def brief(report: dict) -> dict:
    """A report without the fields that only the results page shows."""
    faces = [
        {name: value for name, value in face.items() if name != "look"}
        for face in report.get("faces", [])
    ]
    return {**report, "faces": faces} if faces else report


@contextlib.contextmanager
def claim(shot: dict):
    """Reserves a shot for this process while the context lasts.

    Another process that wants the shot waits until this one has done it or has died. This matters
    when a scheduler loses contact with a node and starts the node's shots again elsewhere while
    they are still running.
    """
    path = os.path.join(os.path.dirname(shot["report"]), CLAIMS)
    place = int.from_bytes(hashlib.blake2b(shot["name"].encode(), digest_size=3).digest())
    with contextlib.ExitStack() as stack:
        # Some network drives do not support locks; there a shot may be done twice.
        with contextlib.suppress(OSError):
            file = stack.enter_context(open(path, "ab"))
            while not _lock(file.fileno(), place):
                time.sleep(_PAUSE_S)
        yield


def _lock(file: int, place: int) -> bool:
    """Locks a byte of a file until the file is closed; False if another process has locked it."""
    try:
        if fcntl is not None:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
        else:
            os.lseek(file, place, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EAGAIN):
            return False
        raise
    return True


def clear(shot: dict) -> None:
    """Removes partial reports of a shot, left by processes that were killed while writing."""
    folder, name = os.path.split(shot["report"])
    for path in glob.glob(os.path.join(glob.escape(folder), f".{glob.escape(name)}.*")):
        with contextlib.suppress(OSError):
            os.remove(path)


def forget(shot: dict) -> None:
    """Removes the old report of a shot; raises `OSError`."""
    if os.path.exists(shot["report"]):
        os.remove(shot["report"])


def close(shot: dict, outcome: dict) -> dict:
    """Writes the report of a shot and its line in the history; returns the report.

    If the report cannot be written, its message says that too.
    """
    where = {"host": socket.gethostname(), "pid": os.getpid()}
    report = {"name": shot["name"], **outcome, "digest": shot["digest"], **where}
    try:
        write_json(shot["report"], report)
        line = json.dumps({"at": round(time.time(), 3), **brief(report)})
        history = os.path.join(os.path.dirname(shot["report"]), HISTORY)
        with open(history, "a", encoding="utf-8") as file:
            file.write(line + "\n")
    except (AnyfaceError, OSError, ValueError) as error:
        report["message"] = f"{report['message']} (its report could not be written: {error})"
    return report
