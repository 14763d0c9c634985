"""Many shots through `python -m anyface_batch batch`, in processes of this machine."""

import json
import signal

import bpy
import pytest

import floor as floors
from figures import curves as curves_of
from figures import tone
from floor import Floor, wait_gone


@pytest.fixture
def floor(tmp_path, installed):
    """A place to run batches in."""
    return Floor(tmp_path, installed)


def test_every_shot_has_its_file_and_its_report(floor):
    floor.write(3)
    code, text = floor.run("--workers", 2)
    assert code == 0, text
    assert "3 of 3 shots are finished" in text
    for name in ("sh00", "sh01", "sh02"):
        report = floor.report(name)
        assert report["ok"] and report["exit_code"] == 0 and report["faces"][0]["frames"] == 48
        assert report["faces"][0]["object"] == "Head"
    bpy.ops.wm.open_mainfile(filepath=str(floor.folder / "out" / "sh02.blend"))
    blocks = bpy.data.objects["Head"].data.shape_keys.key_blocks
    assert blocks[1].name == "Anyface.001"
    assert json.loads((floor.reports / "batch.json").read_text())["ok"] == 3
    assert [path.name for path in (floor.folder / "out").iterdir() if path.name[0] == "."] == []


def test_one_bad_shot_leaves_the_others_alone(floor):
    rows = [
        {"name": "good", "file": "shot.blend", "save": "good.blend", "object": "Head"},
        {"name": "bad", "file": "shot.blend", "save": "bad.blend", "object": "Hed"},
        {"name": "gone", "file": "gone.blend", "save": "none.blend", "object": "Head"},
    ]
    floor.jobs.write_text(json.dumps({"defaults": {"audio": "voice.wav"}, "shots": rows}))
    code, text = floor.run()
    assert code == 12, text
    assert floor.report("good")["ok"] and (floor.folder / "good.blend").exists()
    assert floor.report("bad")["exit_code"] == 3 and "'Hed'" in floor.report("bad")["message"]
    assert floor.report("gone")["exit_code"] == 8
    assert not (floor.folder / "bad.blend").exists()


def test_finished_shots_are_not_done_again_until_they_change(floor):
    floor.write(3)
    assert floor.run("--workers", 2)[0] == 0
    code, text = floor.run("--workers", 2)
    assert code == 0 and "3 of 3 shots were finished before" in text
    assert floor.ended() == {"sh00": 1, "sh01": 1, "sh02": 1}
    (floor.folder / "out" / "sh01.blend").unlink()
    assert floor.run()[0] == 0
    assert floor.ended() == {"sh00": 1, "sh01": 2, "sh02": 1}
    tone(floor.folder / "voice.wav", hertz=330.0)
    assert floor.run("--workers", 2)[0] == 0
    assert floor.ended() == {"sh00": 2, "sh01": 3, "sh02": 2}


def test_a_batch_that_was_killed_is_resumed(floor):
    floor.write(4)
    process = floor.start("--workers", 2, seconds=2.0)
    floor.wait_begun(3)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    for parent, child in floor.begun():
        assert parent == process.pid
        wait_gone(child)
    before = floor.ended()
    assert 1 <= sum(before.values()) < 4
    # If a batch is killed between a report and its line in the history, the line is missing.
    reported = {path.stem for path in floor.reports.glob("sh*.json")}
    code, text = floor.run("--workers", 2)
    assert code == 0, text
    names = {f"sh{n:02d}" for n in range(4)}
    assert floor.ended() == dict.fromkeys(names - (reported - before.keys()), 1)
    assert all(floor.report(name)["ok"] for name in names)


def test_an_interrupt_ends_the_batch_with_a_word_and_the_next_run_goes_on(floor):
    floor.write(3)
    process = floor.start("--workers", 2, seconds=20.0)
    floor.wait_begun(2)
    process.send_signal(signal.SIGINT)
    text = process.communicate(timeout=60)[0]
    assert process.returncode == 9 and "run the batch again to go on" in text, text
    for _, child in floor.begun():
        wait_gone(child)
    assert "stopped" in floor.report("sh00")["message"]
    assert floor.run("--workers", 2)[0] == 0


def test_a_crash_is_tried_again(floor):
    floor.write(1)
    (floor.marks / "crash").touch()
    assert floor.run("--retries", 0)[0] == 12
    report = floor.report("sh00")
    assert report["exit_code"] == 10 and "sh00.log" in report["message"]
    (floor.marks / "crash").touch()
    assert floor.run("--retries", 1)[0] == 0
    assert floor.report("sh00")["ok"]


def test_a_shot_that_takes_too_long_is_stopped(floor):
    floor.write(1)
    code, _ = floor.run("--timeout", 3, "--retries", 0, seconds=60.0)
    assert code == 12 and "longer than 3 s" in floor.report("sh00")["message"]
    for _, child in floor.begun():
        wait_gone(child)


def test_a_row_that_cannot_be_right_has_a_report_and_the_others_are_done(floor):
    good = {"file": "shot.blend", "object": "Head", "save": "a.blend", "audio": "voice.wav"}
    rows = [good]
    said = {}
    for row, words in (
        ({**good, "strp": "Voice"}, "--strp=Voice"),
        ({**good, "name": "x1", "save": "b.blend"}, "have the output"),
        ({**good, "name": "x2", "save": "../{0}/b.blend"}, "have the output"),
        ({**good, "name": "x3", "save": "shot.blend"}, "read and written"),
        ({**good, "name": "x4", "save": "voice.wav"}, "read and written"),
        ({"object": "Head", "save": "x5.blend"}, "'file'"),
        ({**good, "name": "x6", "save": "x6.blend", "seed": "many"}, "many"),
        ({"file": "shot.blend", "save": "x7.blend"}, "--object"),
        ({**good, "name": "../a", "save": "x8.blend"}, "name"),
        ("sh010", "expected an object"),
        ({**good, "name": "x10", "save": "c.blend", "object": "He\0ad"}, "without a null"),
    ):
        if isinstance(row, dict):
            row["save"] = row["save"].format(floor.folder.name)
        rows.append(row)
        said[len(rows)] = words
    floor.jobs.write_text(json.dumps({"shots": rows}))
    code, text = floor.run()
    assert code == 12 and "1 of 12 shots are finished" in text, text
    assert floor.report("a")["ok"] and (floor.folder / "a.blend").exists()
    failed = json.loads((floor.reports / "batch.json").read_text())["failed"]
    messages = [floor.report(name)["message"] for name in failed]
    for number, words in said.items():
        (message,) = [message for message in messages if f"shot {number}" in message.split(":")[0]]
        assert words in message and "mend the row" in message and message in text
    assert sorted(path.name for path in floor.folder.glob("*.blend")) == ["a.blend", "shot.blend"]


def test_a_jobs_file_that_is_none_is_refused(floor):
    for text, code in (("[", 3), ('{"defaults": [], "shots": []}', 3), (None, 8)):
        floor.jobs.write_text(text) if text else floor.jobs.unlink()
        assert floor.run()[0] == code


def test_one_process_does_shots_in_a_row_and_a_crash_loses_one_of_them(floor):
    floor.write(6)
    assert floor.run("--chunk", 3)[0] == 0
    processes = [child for _, child in floor.begun()]
    assert [processes.count(each) for each in dict.fromkeys(processes)] == [3, 3]
    logs = [(floor.reports / f"sh0{n}.log").read_text() for n in range(6)]
    assert all("frames" in log and "\x1e" not in log for log in logs), logs
    (floor.marks / "crash").touch()
    code, text = floor.run("--again", "--retries", 0)
    assert code == 12 and "5 of 6 shots are finished" in text, text
    assert not floor.report("sh00")["ok"]
    assert floor.run()[0] == 0
    assert floor.ended() == {"sh00": 3, **{f"sh0{n}": 2 for n in range(1, 6)}}


def test_shots_of_one_process_are_those_of_a_process_each(floor):
    def motion(name):
        bpy.ops.wm.open_mainfile(filepath=str(floor.folder / "out" / f"{name}.blend"))
        keys = bpy.data.objects["Head"].data.shape_keys
        curves = curves_of(keys.animation_data.action)
        shapes = [[tuple(point.co) for point in key.data] for key in keys.key_blocks]
        return shapes, [[tuple(point.co) for point in curve.keyframe_points] for curve in curves]

    floor.write(3)
    assert floor.run("--chunk", 3)[0] == 0
    together = [motion(f"sh0{n}") for n in range(3)]
    assert floor.run("--chunk", 1, "--again")[0] == 0
    assert together == [motion(f"sh0{n}") for n in range(3)]


def test_some_rows_of_a_file_are_done_alone(floor):
    floor.write(5)
    code, text = floor.run("--rows", "2-3")
    assert code == 0 and "2 of 2 shots are finished" in text, text
    assert floor.ended() == {"sh01": 1, "sh02": 1}
    assert not (floor.reports / "batch.json").exists(), "others may be at work on the other rows"
    assert floor.run("--rows", "5-9")[0] == 0
    code, text = floor.run("--sum")
    assert code == 0 and "3 of 5" in text and "2 have no report yet" in text, text
    assert json.loads((floor.reports / "batch.json").read_text())["ok"] == 3
    for words in ("6-8", "0-3", "3-2", "x"):
        code, text = floor.run("--rows", words)
        assert code in (2, 3) and "expected rows" in text, text


def test_a_dry_run_says_what_is_left_and_does_nothing(floor):
    floor.write(3)
    assert floor.run("--rows", "1")[0] == 0
    content = json.loads(floor.jobs.read_text())
    content["shots"][2]["strp"] = "Voice"
    floor.jobs.write_text(json.dumps(content))
    before = sorted(floor.folder.rglob("*"))
    code, text = floor.run("--dry-run")
    assert code == 12 and "1 shots are finished, 1 are left, 1 cannot be right" in text, text
    assert "--strp" in text and "MB" in text
    assert sorted(floor.folder.rglob("*")) == before


def test_folders_with_another_name_are_found(floor):
    floor.write(1, audio="Z:\\show\\voice.wav", file="/mnt/show/shot.blend")
    maps = f"/mnt/show={floor.folder}", f"{floor.folder}=Z:\\show"
    code, text = floor.run("--map", maps[0], "--map", maps[1])
    assert code == 0, text
    content = json.loads(floor.jobs.read_text())
    assert floor.run("--map", maps[0], "--map", maps[1])[1].count("finished before") == 1
    assert content["defaults"]["audio"].startswith("Z:")
    code, text = floor.run("--map", "/mnt/show")
    assert code == 3 and "expected FROM=TO" in text


def test_the_page_shows_every_shot_and_what_went_wrong_first(floor):
    floor.write(3)
    content = json.loads(floor.jobs.read_text())
    content["shots"][1] |= {"object": "</script><b>", "name": "bad"}
    floor.jobs.write_text(json.dumps(content))
    code, text = floor.run()
    assert code == 12 and "results.html" in text
    page = (floor.reports / "results.html").read_text()
    rows = floors.rows_of(page)
    assert rows[0]["name"] == "bad" and rows[0]["reasons"][0] == "failed"
    assert sorted(row["name"] for row in rows) == ["bad", "sh00", "sh02"]
    assert "</script><b>" not in page.replace("<\\/", "")
    good = rows[1]
    assert len(good["wave"]) == 200 and max(good["wave"]) == 1.0
    history = (floor.reports / "history.jsonl").read_text()
    assert "wave" not in history and "sh02" in history


def test_a_shot_that_is_at_work_elsewhere_is_waited_for_and_not_done_twice(floor):
    floor.write(1)
    first = floor.start(seconds=3.0)
    floor.wait_begun(1)
    code, text = floor.run()
    assert code == 0 and "1 of 1 shots are finished" in text, text
    assert first.communicate(timeout=60)[0] and first.returncode == 0
    assert floor.ended() == {"sh00": 1} and len(floor.begun()) == 1
