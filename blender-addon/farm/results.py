"""The results of a batch: `batch.json`, and a web page with the shots to check at its top."""

import json
from pathlib import Path

from ..core import json_file
from ..core.errors import AnyfaceError
from . import export, jobs, ledger, receipts

# To keep the page small, only this many rows, the ones that most need a check, have pictures and
# curves.
_SHOWN = 100


def paths(folder: Path) -> tuple[Path, Path]:
    """The paths of the summary and of the page."""
    return folder / f"{jobs.SUMMARY}.json", folder / "results.html"


def write(folder: Path, reports: list[dict], seconds: float | None) -> dict:
    """Writes both into `folder` and returns the summary; raises `AnyfaceError("file")`."""
    rows = sorted(reports, key=lambda report: report["name"])
    summary = {
        "ok": sum(report["ok"] for report in rows),
        "failed": [report["name"] for report in rows if not report["ok"]],
        "seconds": seconds,
        "shots": [ledger.brief(report) for report in rows],
    }
    summary_path, page_path = paths(folder)
    receipts.write(summary_path, json_file.to_text(summary))
    try:
        page = (export.templates() / "results.html").read_text(encoding="utf-8")
        # "</script>" would end the page's script, and after "<!--<script>" its own end would not
        # count.
        data = json.dumps(_ranked(rows)).replace("<", "\\u003c")
        receipts.write(page_path, page.replace("{{ROWS}}", data))
    except OSError as error:
        raise AnyfaceError("file", f"{error.filename}: {error.strerror}") from error
    return summary


def _ranked(reports: list[dict]) -> list[dict]:
    """A row of the page for each report, the ones that most need a check first."""
    times = sorted(report.get("seconds", 0.0) for report in reports)
    usual = times[len(times) // 2] if times else 0.0
    rows = sorted((_row(report, usual) for report in reports), key=lambda row: -row["attention"])
    for row in rows[_SHOWN:]:
        for field in ("gap", "wave", "pictures"):
            row.pop(field, None)
    return rows


def _row(report: dict, usual_s: float) -> dict:
    looks = [face.get("look", {}) for face in report.get("faces", [])]
    row = {name: report[name] for name in ("name", "ok", "message")}
    row |= {name: report[name] for name in ("seconds", "host", "memory_mb") if name in report}
    row |= {name: value for look in looks[:1] for name, value in look.items()}
    row["warnings"] = [text for look in looks for text in look.get("warnings", [])]
    row["out"] = report.get("file", "")
    slow = report["ok"] and report.get("seconds", 0.0) > 3.0 * usual_s + 1.0
    reasons = [] if report["ok"] else ["failed"]
    reasons += row["warnings"] + (["took far longer than the others"] if slow else [])
    attention = 100.0 * (not report["ok"]) + 10.0 * len(row["warnings"]) + 1.0 * slow
    return row | {"reasons": reasons, "attention": attention}
