"""Reports on disk: one JSON file a shot, one history of all tries."""

import json
import os
import socket
import time

from ..core.errors import AnyfaceError
from ..core.json_file import read as read_json
from ..core.json_file import write as write_json

# The file beside the reports with a line for each end of a shot.
HISTORY = "history.jsonl"


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
