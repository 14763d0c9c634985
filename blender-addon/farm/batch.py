"""`anyface batch jobs.json`: finds the shots that are left, runs them, reports the results."""

import argparse
import contextlib
import shutil
import sys
import time
from dataclasses import asdict
from pathlib import Path

from ..core.errors import EXIT_CODES, AnyfaceError, plain, say
from . import cluster, export, jobs, ledger, local, receipts, results
from .paths import PathMap

_GO_ON = "what is finished stays, run the batch again to go on"
_ENTRY = Path(__file__).resolve().parents[1] / "anyface_batch.py"


def run(options: argparse.Namespace, blender: str = "") -> int:
    """Does the shots, prints a line for each, and returns the exit code.

    `blender` is the Blender executable that runs this code, "" for plain Python.
    """
    try:
        is_whole = _run(options, options.blender or blender)
    except BaseException as raised:
        error = plain(raised)
        more = "" if isinstance(raised, AnyfaceError) else f": {_GO_ON}"
        say(f"anyface: {error}{more}", sys.stderr)
        return error.exit_code
    return 0 if is_whole else EXIT_CODES["shots"]


def _run(options, blender: str) -> bool:
    """Exports, sums up, plans or does the rows; returns whether all of them are fine."""
    for name in ("workers", "chunk"):
        if getattr(options, name) < 1:
            text = f"--{name}: expected 1 or more, got {getattr(options, name)}"
            raise AnyfaceError("input", text)
    paths = PathMap(options.map)
    path = Path(paths.here(options.jobs))
    default = path.with_suffix(".reports")
    folder = Path(paths.here(options.reports) if options.reports else default).resolve()
    listed = jobs.read(path, folder, paths, options.rows)
    if options.export:
        node = _node(options, paths.here(blender), path, folder)
        return _export(options, node, paths, listed, folder)
    if options.sum:
        return _sum(folder, listed)
    if options.dry_run:
        return _tell_plan(options, listed)
    return _work(options, command(paths.here(blender)), folder, listed)


def _work(options, words: list[str], folder: Path, listed: jobs.Listed) -> bool:
    """Does the rows that are left and prints the result of each; returns whether all are done."""
    began = time.monotonic()
    shots = [asdict(shot) for shot in listed.shots]
    total = len(shots) + len(listed.broken)
    ledger.check([*shots, *(asdict(row.shot) for row in listed.broken)])
    if options.rows is None:
        receipts.check(*results.paths(folder))
    if options.again:
        for shot in shots:
            ledger.forget(shot)
    reports = [report for shot in shots if (report := ledger.finished(shot)) is not None]
    finished = {report["name"] for report in reports}
    left = [shot for shot in shots if shot["name"] not in finished]
    if reports:
        say(f"anyface: {len(reports)} of {total} shots were finished before", sys.stdout)
    for row in listed.broken:
        reports.append(ledger.close(asdict(row.shot), row.outcome))
        _tell(reports[-1], len(reports), total)
    with contextlib.closing(_start(options, words, left)) as ended:
        for report in ended:
            reports.append(report)
            _tell(report, len(reports), total)
    well = sum(report["ok"] for report in reports)
    say(f"anyface: {well} of {total} shots are finished, reports in {folder}", sys.stdout)
    if options.rows is None:
        # With --rows other processes do the other rows: a summary from here would be incomplete.
        results.write(folder, reports, round(time.monotonic() - began, 3))
        say(f"anyface: {folder / 'results.html'} shows them", sys.stdout)
    return well == total


def _export(options, node: export.NodeCommand, paths, listed, folder: Path) -> bool:
    """Writes the files that a farm's engine runs, and prints what to type next."""
    for row in listed.broken:
        say(f"anyface: {row.outcome['message']}", sys.stderr)
    saves = export.saves(Path(node.jobs), paths, listed)
    say(f"anyface: {export.run(options, node, saves, folder)}", sys.stdout)
    return True


def _node(options, blender: str, path: Path, folder: Path) -> export.NodeCommand:
    """The command that a farm node runs for some of the rows, with the options of this run."""
    program, *before = command(blender)
    if blender and options.export == "flamenco":
        # Flamenco's workers know where their Blender is.
        program = "{blender}"
    words = ["--reports", str(folder)] if options.reports else []
    for word, value, default in (
        ("--workers", options.workers, 1),
        ("--chunk", options.chunk, 20),
        ("--retries", options.retries, 1),
        ("--timeout", options.timeout, None),
    ):
        if value != default:
            words += [word, f"{value:g}"]
    for folders in options.map:
        words += ["--map", folders]
    return export.NodeCommand(program, (*before[:-1], "batch"), str(path.resolve()), tuple(words))


def _start(options, words: list[str], shots: list[dict]):
    if not shots:
        return (nothing for nothing in ())
    limits = {"retries": options.retries, "timeout_s": options.timeout}
    if options.scheduler:
        where = options.scheduler, options.connect
        return cluster.run(words, shots, *where, options.chunk, **limits)
    return local.run(words, shots, options.workers, options.chunk, **limits)


def _sum(folder: Path, listed: jobs.Listed) -> bool:
    """Writes the results of all rows from their reports."""
    rows = [asdict(shot) for shot in listed.shots]
    receipts.check(*results.paths(folder))
    ledger.check([asdict(row.shot) for row in listed.broken])
    reports = [report for shot in rows if (report := ledger.read(shot["report"])) is not None]
    for row in listed.broken:
        shot = asdict(row.shot)
        reports.append(ledger.read(shot["report"]) or ledger.close(shot, row.outcome))
    total = len(rows) + len(listed.broken)
    well = results.write(folder, reports, None)["ok"]
    missing = f", {total - len(reports)} have no report yet" if total > len(reports) else ""
    say(f"anyface: {well} of {total} shots are finished{missing}", sys.stdout)
    say(f"anyface: {folder / 'results.html'} shows them", sys.stdout)
    # Rows without a report do not count as failed: they are still being done elsewhere.
    return all(report["ok"] for report in reports)


def _tell_plan(options, listed: jobs.Listed) -> bool:
    """Prints what a run would do; returns whether all rows are valid."""
    known = [ledger.read(shot.report) for shot in listed.shots]
    known = [report for report in known if report is not None]
    left = [shot for shot in listed.shots if ledger.finished(asdict(shot)) is None]
    for row in listed.broken:
        say(f"anyface: {row.shot.name}: {row.outcome['message']}", sys.stderr)
    say(
        f"anyface: {len(listed.shots) - len(left)} shots are finished, {len(left)} are left, "
        f"{len(listed.broken)} cannot be right",
        sys.stdout,
    )
    seconds = [report["seconds"] for report in known if report["ok"] and "seconds" in report]
    if left and seconds:
        minutes = sum(seconds) / len(seconds) * len(left) / options.workers / 60.0
        say(f"anyface: by earlier reports they take about {minutes:.1f} min", sys.stdout)
    memory = max((report.get("memory_mb") or 0 for report in known), default=0)
    if memory:
        say(f"anyface: by earlier reports a process takes up to {memory} MB", sys.stdout)
    return not listed.broken


def command(blender: str) -> list[str]:
    """The command that starts a process for shots.

    It runs a Blender that has the extension, or this Python with bpy.
    """
    if blender:
        return [shutil.which(blender) or blender, "-b", "--command", "anyface", "shot"]
    return [sys.executable, str(_ENTRY), "shot"]


def _tell(report: dict, number: int, total: int) -> None:
    stream = sys.stdout if report["ok"] else sys.stderr
    say(f"anyface: {number}/{total} {report['name']}: {report['message']}", stream)
