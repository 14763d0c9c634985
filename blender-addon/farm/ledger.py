"""Reports on disk: one JSON file a shot, one history of all tries."""

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
    # Windows has another one.
    import msvcrt

    fcntl = None

# The file beside the reports with a line for each end of a shot.
HISTORY = "history.jsonl"
# The file beside it of which a process locks a byte for each shot at work.
CLAIMS = ".claims"
_PAUSE_S = 0.1


def read(report: str) -> dict | None:
    """A report, or None where there is none or it is not one of ours."""
    try:
        content = read_json(report)
    except AnyfaceError:
        return None
    is_ours = isinstance(content, dict) and {"name", "ok", "message"} <= content.keys()
    return content if is_ours else None


def finished(shot: dict) -> dict | None:
    """The report of a shot (`asdict(Shot)`) that was done as it stands now, and lies there."""
    report = read(shot["report"])
    if report is None or not report.get("ok") or report.get("digest") != shot["digest"]:
        return None
    return report if os.path.isfile(shot["save"]) else None


def brief(report: dict) -> dict:
    """A report without what only a page shows."""
    faces = [
        {name: value for name, value in face.items() if name != "look"}
        for face in report.get("faces", [])
    ]
    return {**report, "faces": faces} if faces else report


@contextlib.contextmanager
def claim(shot: dict):
    """Keeps a shot for this process: another one that wants it waits until this one ends, however
    it ends.

    A scheduler that lost sight of a node starts its shots elsewhere while they still run there.
    """
    path = os.path.join(os.path.dirname(shot["report"]), CLAIMS)
    place = int.from_bytes(hashlib.blake2b(shot["name"].encode(), digest_size=3).digest())
    with contextlib.ExitStack() as stack:
        # Some network drives lock nothing; there it may be done twice.
        with contextlib.suppress(OSError):
            file = stack.enter_context(open(path, "ab"))
            while not _lock(file.fileno(), place):
                time.sleep(_PAUSE_S)
        yield


def _lock(file: int, place: int) -> bool:
    """Locks a byte of a file until it is closed; False where another process has it."""
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
    """Takes away what processes that were killed while they wrote its report have left."""
    folder, name = os.path.split(shot["report"])
    for path in glob.glob(os.path.join(glob.escape(folder), f".{glob.escape(name)}.*")):
        with contextlib.suppress(OSError):
            os.remove(path)


def forget(shot: dict) -> None:
    """Takes an old report away; raises `OSError`."""
    if os.path.exists(shot["report"]):
        os.remove(shot["report"])


def close(shot: dict, outcome: dict) -> dict:
    """Writes the report of a shot and its line in the history; returns the report.

    Where it cannot be written, its message says so too.
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
