"""A batch in which rows fail, each for a reason of its own. All other rows still finish.

`ANYFACE_BATCH=500,50` makes a batch of 500 rows, 50 of them broken.
"""

import json
import os
import re
import shutil
import time
from pathlib import Path

import bpy
import pytest

import floor as floors
from figures import tone, write_wav
from floor import Floor

ROWS, BROKEN = map(int, os.environ.get("ANYFACE_BATCH", "36,26").split(","))
HOSTILE = Path(os.environ.get("ANYFACE_SHARED", "../shared")) / "hostile"
KILLED = 666


@pytest.fixture
def floor(tmp_path, installed, monkeypatch):
    """A place to run batches in, with a camera in the scene."""
    monkeypatch.setattr(floors, "LIMIT_S", 10.0 * ROWS)
    new_floor = Floor(tmp_path, installed)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    tone(tmp_path / "voice.wav", seconds=0.25)
    return new_floor


def hostile(kind: str, number: int, floor) -> str:
    """The path of a damaged file of this kind. Writes a short one if `HOSTILE` has none."""
    paths = sorted((HOSTILE / kind).glob(*{"audio": ["*.wav"], "mesh": ["*"], "json": ["*"]}[kind]))
    paths = [path for path in paths if path.name not in HARMLESS]
    if paths:
        return str(paths[number % len(paths)].resolve())
    path = floor.folder / f"damaged.{kind}"
    path.write_bytes(b'RIFF\xff\xff\xff\xffWAVE{"shots": [')
    return str(path)


# Odd files that are valid sounds all the same.
HARMLESS = (
    "ok.wav", "bits24_al4.wav", "bits8_f.wav", "len_max.wav", "oddlen.wav", "rate768k.wav",
    "align0.wav", "align_odd.wav", "ch65535.wav", "ch65535b.wav", "f32_3e38.wav", "len0_stream.wav",
    "bits12.wav", "bits64.wav", "tiny1.wav", "rate8.wav",
)  # fmt: skip


def kinds(floor) -> list[tuple[str, object]]:
    """The ways to break a row: a pattern that its report must match, and the change to the row.

    The change is a function of how often this way was used before.
    """
    folder = floor.folder
    write_wav(folder / "empty.wav", [], 16000)
    (folder / "cut.blend").write_bytes((folder / "shot.blend").read_bytes()[:4000])
    (folder / "folder.wav").mkdir()
    return [
        (r"gone\.wav", lambda n: {"audio": "gone.wav"}),
        (r"no file at .*gone\.blend", lambda n: {"file": "gone.blend"}),
        (r"'Hed'", lambda n: {"object": "Hed"}),
        (r"\.wav|damaged", lambda n: {"audio": hostile("audio", n, floor)}),
        (r"mesh|damaged", lambda n: {"file": hostile("mesh", n, floor)}),
        (r"json|damaged", lambda n: {"landmarks": hostile("json", n, floor)}),
        (r"cut\.blend", lambda n: {"file": "cut.blend"}),
        (r"seed: expected text or a number", lambda n: {"seed": [n]}),
        (r"expected an object, got 'sh", lambda n: "sh010"),
        (r"many", lambda n: {"seed": "many"}),
        (r"--system|system", lambda n: {"system": "talkie"}),
        (r"--strp", lambda n: {"strp": "Voice"}),
        (r"happyy", lambda n: {"emotion": "happyy:1"}),
        (r"have the output", lambda n: {"save": "out/twice.blend"}),
        (r"have the output", lambda n: {"save": "out/../out/TWICE.blend"}),
        (r"read and written", lambda n: {"save": "shot.blend"}),
        (r"empty\.wav|sound|silent", lambda n: {"audio": "empty.wav"}),
        (r"name: expected", lambda n: {"name": "sh/0 💥"}),
        (r"killed|ended early", lambda n: {"seed": KILLED}),
        (r"without a null", lambda n: {"object": "He\0ad"}),
        (r"voice\.wav", lambda n: {"save": f"voice.wav/{n}.blend"}),
        (r"Camera", lambda n: {"object": "Camera"}),
        (r"folder\.wav", lambda n: {"audio": "folder.wav"}),
        (r"mode: expected", lambda n: {"mode": "films"}),
        (r"events|gone\.json", lambda n: {"events": "gone.json"}),
        (r"--fps: expected a finite number", lambda n: {"fps": "nan"}),
    ]


def rows(floor) -> tuple[list, dict[int, str]]:
    """All rows, and the error pattern of each broken row by its number (from 1)."""
    ways, shots, wrong, turn = kinds(floor), [], {}, 0
    for number in range(1, ROWS + 1):
        row = {"name": f"sh{number:03d}", "save": f"out/Szene ä{number:03d}.blend", "seed": number}
        # Spread the broken rows evenly. Break all remaining rows if otherwise too few would be.
        if turn < BROKEN and (number * BROKEN // ROWS > turn or ROWS - number < BROKEN - turn):
            words, change = ways[turn % len(ways)]
            change = change(turn // len(ways))
            row = {**row, **change} if isinstance(change, dict) else change
            wrong[number] = words
            turn += 1
        shots.append(row)
    return shots, wrong


def files_in(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_every_good_row_is_done_and_every_broken_one_says_why(floor):
    shots, wrong = rows(floor)
    defaults = {"file": "shot.blend", "object": "Head", "audio": "voice.wav"}
    floor.jobs.write_text(json.dumps({"defaults": defaults, "shots": shots}))
    good = [n for n in range(1, ROWS + 1) if n not in wrong]
    assert len(wrong) == BROKEN
    before, began = set(files_in(floor.folder)), time.monotonic()
    code, text = floor.run("--workers", 2, "--retries", 0, more={"ANYFACE_TEST_KILL": str(KILLED)})
    print(f"{ROWS} rows, {BROKEN} broken: {time.monotonic() - began:.0f} s")
    assert code == 12 and f"{len(good)} of {ROWS} shots are finished" in text, text
    summary = json.loads((floor.reports / "batch.json").read_text())
    assert len(summary["shots"]) == ROWS and len(summary["failed"]) == BROKEN
    for number in good:
        assert floor.report(f"sh{number:03d}")["ok"]
    failed = [floor.report(name) for name in summary["failed"]]
    for report in failed:
        print(report["name"], report["exit_code"], report["message"].replace(str(floor.folder), ""))
    for number, words in wrong.items():
        row = shots[number - 1]
        named = row.get("name") if isinstance(row, dict) else None
        of_row = [r for r in failed if r["name"] in (named, f"row-{number}")]
        assert len(of_row) == 1, (number, row)
        (report,) = of_row
        assert re.search(words, report["message"]), (row, report)
        assert "Traceback" not in report["message"] and report["exit_code"] not in (0, 2)
        assert f"{report['name']}: {report['message'][:40]}" in text
        # Only a killed process may report an internal error, as it cannot say what went wrong.
        assert report["kind"] != "internal" or "kill" in words, report
    fresh = {path for path in files_in(floor.folder) if path not in before}
    fresh = {path for path in fresh if not path.startswith(("jobs.reports/", "marks/"))}
    assert fresh == {f"out/Szene ä{number:03d}.blend" for number in good}, "nothing is half written"
    reports = files_in(floor.reports)
    kinds_of_report = (".json", ".log", ".jsonl", "results.html", ".claims", ".anyface-receipts")
    assert [path for path in reports if not path.endswith(kinds_of_report)] == []
    _mended(floor, shots, wrong, defaults)


def _mended(floor, shots: list, wrong: dict, defaults: dict) -> None:
    """Mends two rows and drops the other broken ones. A second run does only the mended rows."""
    mended = [number for number in wrong if isinstance(shots[number - 1], dict)][:2]
    for number in mended:
        keys = {"name": f"sh{number:03d}", "save": f"out/Szene ä{number:03d}.blend", "seed": number}
        shots[number - 1] = keys
    others = [row for number, row in enumerate(shots, 1) if number not in wrong or number in mended]
    floor.jobs.write_text(json.dumps({"defaults": defaults, "shots": others}))
    shutil.rmtree(floor.marks)
    floor.marks.mkdir()
    code, text = floor.run("--workers", 2)
    assert code == 0 and f"{ROWS - BROKEN} of {len(others)} shots were finished before" in text
    assert len(floor.begun()) == len(mended)
    ended = floor.ended()
    assert all(ended[f"sh{n:03d}"] == 1 for n in range(1, ROWS + 1) if n not in wrong)
