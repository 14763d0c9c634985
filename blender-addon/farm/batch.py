"""`anyface batch jobs.json`: what is left to do, where it is done, what came of it."""

import argparse
import contextlib
import shutil
import sys
import time
from dataclasses import asdict
from pathlib import Path

from ..core import json_file
from ..core.errors import EXIT_CODES, AnyfaceError, plain, say
from . import cluster, jobs, ledger, local

_GO_ON = "what is finished stays, run the batch again to go on"
_ENTRY = Path(__file__).resolve().parents[1] / "anyface_batch.py"


def run(options: argparse.Namespace, blender: str = "") -> int:
    """Does the shots, prints a line each, returns the exit code.

    `blender` is the executable that runs this, "" for plain Python.
    """
    try:
        reports = _run(options, options.blender or blender)
    except BaseException as raised:
        error = plain(raised)
        more = "" if isinstance(raised, AnyfaceError) else f": {_GO_ON}"
        say(f"anyface: {error}{more}", sys.stderr)
        return error.exit_code
    return 0 if all(report["ok"] for report in reports) else EXIT_CODES["shots"]


def _run(options, blender: str) -> list[dict]:
    began = time.monotonic()
    path = Path(options.jobs)
    folder = Path(options.reports or path.with_suffix(".reports")).resolve()
    listed = jobs.read(path, folder)
    shots = [asdict(shot) for shot in listed.shots]
    total = len(shots) + len(listed.broken)
    if options.workers < 1:
        raise AnyfaceError("input", f"--workers: expected 1 or more, got {options.workers}")
    if options.again:
        for shot in shots:
            ledger.forget(shot)
    reports = [report for shot in shots if (report := ledger.finished(shot)) is not None]
    kept = {report["name"] for report in reports}
    left = [shot for shot in shots if shot["name"] not in kept]
    if reports:
        say(f"anyface: {len(reports)} of {total} shots were finished before", sys.stdout)
    for row in listed.broken:
        reports.append(ledger.close(asdict(row.shot), row.outcome))
        _tell(reports[-1], len(reports), total)
    limits = {"retries": options.retries, "timeout_s": options.timeout}
    with contextlib.closing(_start(options, command(blender), left, limits)) as ended:
        for report in ended:
            reports.append(report)
            _tell(report, len(reports), total)
    summary = _summary(reports, time.monotonic() - began)
    say(f"anyface: {summary['ok']} of {total} shots are finished, reports in {folder}", sys.stdout)
    json_file.write(folder / f"{jobs.SUMMARY}.json", summary)
    return reports


def _start(options, words: list[str], shots: list[dict], limits: dict):
    if not shots:
        return (nothing for nothing in ())
    if options.scheduler:
        return cluster.run(words, shots, options.scheduler, options.connect, **limits)
    return local.run(words, shots, options.workers, **limits)


def command(blender: str) -> list[str]:
    """How one shot is started: a Blender that has the extension, or this Python with bpy."""
    if blender:
        return [shutil.which(blender) or blender, "-b", "--command", "anyface", "shot"]
    return [sys.executable, str(_ENTRY), "shot"]


def _tell(report: dict, number: int, total: int) -> None:
    stream = sys.stdout if report["ok"] else sys.stderr
    say(f"anyface: {number}/{total} {report['name']}: {report['message']}", stream)


def _summary(reports: list[dict], seconds: float) -> dict:
    rows = sorted(reports, key=lambda report: report["name"])
    return {
        "ok": sum(report["ok"] for report in reports),
        "failed": [report["name"] for report in rows if not report["ok"]],
        "seconds": round(seconds, 3),
        "shots": rows,
    }
