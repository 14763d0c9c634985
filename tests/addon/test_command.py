"""Calls the command in this process. A `Stage` replaces the library."""

import json

import bpy
import numpy as np
import pytest

from figures import grid, stand_in, tone
from test_heads import import_head


@pytest.fixture
def run(addon):
    """`run("bake", …)` returns the exit code. `run.stage` replaces the library."""
    stage = stand_in(addon)

    def call(*words):
        return addon("command").main([str(word) for word in words])

    call.stage = stage
    return call


def test_bake_writes_the_file_and_the_report(run, tmp_path):
    grid()
    bpy.context.scene.frame_start = 3
    sound, out, report = tone(tmp_path / "a.wav"), tmp_path / "o.blend", tmp_path / "r.json"
    code = run(
        "bake",
        "--object",
        "Head",
        "--audio",
        sound,
        "--emotion",
        "happy:0.7,calm:0.2",
        "--fps",
        12,
        "--seed",
        9,
        "--steps",
        3,
        "--jaw",
        -0.5,
        "--blinks",
        7,
        "--decoder",
        "paper",
        "--system",
        "freetalk",
        "--save",
        out,
        "--report",
        report,
    )
    assert code == 0
    request = run.stage.calls[0][5]
    assert (request.fps, request.fields["seed"], request.controls["steps"]) == (12.0, 9, 3)
    names = ("jaw", "blinks_per_minute", "decoder", "articulation")
    assert [request.controls[name] for name in names] == [-0.5, 7.0, 1.0, 1.0]
    row = request.fields["emotion"][0][1]
    assert row[1] == 0.7 and row[3] == 0.2
    outcome = json.loads(report.read_text())
    assert outcome["ok"] and outcome["exit_code"] == 0 and "24 frames" in outcome["message"]
    bpy.ops.wm.open_mainfile(filepath=str(out))
    blocks = bpy.data.objects["Head"].data.shape_keys.key_blocks
    assert blocks[1].name == "Anyface.001"


def test_bake_takes_teeth_and_lashes_along(run, tmp_path):
    ob = grid()
    for name in ("Teeth_lower", "Head.003", "Lamp"):
        grid(name, scale=0.02)
    grid("Head.004", scale=0.19)
    sound, out, report = tone(tmp_path / "a.wav"), tmp_path / "o.blend", tmp_path / "r.json"
    words = ("bake", "--object", "Head", "--audio", sound, "--save", out, "--report", report)
    assert run(*words) == 0
    assert [part.name for part in ob.anyface_face.parts] == ["Head.003", "Teeth_lower"]
    assert "(together with Head.003 and Teeth_lower)" in json.loads(report.read_text())["message"]
    assert ob.anyface.report.endswith("(together with Head.003 and Teeth_lower)")


def test_options_that_are_left_out_come_from_the_object(run, tmp_path):
    ob = grid()
    ob.anyface.seed, ob.anyface.mode = 5, "frames"
    sound = tone(tmp_path / "a.wav")
    save = ("--save", tmp_path / "o.blend")
    assert run("bake", "--object", "Head", "--audio", sound, *save) == 0
    assert run.stage.calls[0][5].fields["seed"] == 5
    assert not ob.data.shape_keys.use_relative
    assert run("bake", "--object", "Head", "--audio", sound, "--mode", "basis", *save) == 0
    assert ob.data.shape_keys.use_relative


def test_controls_on_the_command_line_replace_keyframes(run, tmp_path):
    ob = grid()
    for name in ("articulation", "asymmetry"):
        for frame, value in ((1, 0.0), (49, 1.0)):
            setattr(ob.anyface, name, value)
            ob.keyframe_insert(f"anyface.{name}", frame=frame)
    words = ("--audio", tone(tmp_path / "a.wav"), "--save", tmp_path / "o.blend")
    assert run("bake", "--object", "Head", "--articulation", "0.5", *words) == 0
    request = run.stage.calls[0][5]
    assert request.controls["articulation"] == 0.5 and list(request.control_keys) == ["asymmetry"]


def test_words_come_from_an_option_or_a_file(run, tmp_path, capfd):
    ob = grid()
    ob.anyface.source, ob.anyface.sound_file = "FILE", str(tone(tmp_path / "own.wav"))
    bpy.context.scene.anyface.text = "what the own sound says"
    bake = ("bake", "--object", "Head", "--save", tmp_path / "o.blend")
    file, other = tmp_path / "said.txt", ("--audio", tone(tmp_path / "a.wav"))
    file.write_text("\ufeffGood evening.\n", encoding="utf-8")
    asked = (), other, ("--text", "hello"), (*other, "--text-file", file)
    for words in asked:
        assert run(*bake, *words) == 0
    texts = [call[5].fields["text"] for call in run.stage.calls]
    assert texts == ["what the own sound says", "", "hello", "Good evening."]
    assert run(*bake, "--text", "a", "--text-file", file) == 2
    file.write_bytes(b"\xff\xfe\xff")
    assert run(*bake, "--text-file", file) == 3
    assert "UTF-8" in capfd.readouterr().err


def test_exit_codes_differ_by_kind(run, tmp_path, capfd):
    grid()
    sound, out = tone(tmp_path / "a.wav"), tmp_path / "o.blend"
    save = ("--save", out)
    assert run("bake", "--object", "Hed", "--audio", sound, *save) == 3
    assert "'Hed'" in capfd.readouterr().err
    assert run("bake", "--object", "Head", "--audio", tmp_path / "no.wav", *save) == 4
    assert run("bake", "--object", "Head", "--strip", "Voice", *save) == 4
    assert run("bake", "--object", "Head", "--audio", sound, "--emotion", "merry:1", *save) == 3
    run.stage.size = 1e-7
    assert run("bake", "--object", "Head", "--audio", sound, *save) == 11
    assert "nothing moved" in capfd.readouterr().err
    assert run("bake", "--object", "Head") == 2
    assert run("bake", "--nonsense") == 2
    assert run() == 2
    assert run("bake", "--help") == 0
    assert not out.exists()


def test_a_file_that_cannot_be_written_is_an_error(run, tmp_path):
    grid()
    sound = tone(tmp_path / "a.wav")
    out = tmp_path / "no" / "such" / "folder" / "o.blend"
    assert run("bake", "--object", "Head", "--audio", sound, "--save", out) == 8


def test_rig_gives_the_shapes_of_arkit_as_keys(addon, tmp_path):
    import_head()
    addon("ui.running")._engines.clear()
    out, report = tmp_path / "o.blend", tmp_path / "r.json"
    words = ["rig", "--object", "Head", "--save", str(out), "--report", str(report)]
    assert addon("command").main(words) == 0
    bpy.ops.wm.open_mainfile(filepath=str(out))
    ob = bpy.data.objects["Head"]
    blocks = ob.data.shape_keys.key_blocks
    assert [block.name for block in blocks[1:]] == list(addon("core.shapes").ARKIT)
    assert all(block.value == 0.0 for block in blocks[1:])
    rest, jaw = points(blocks[0]), points(blocks["jawOpen"])
    # `jawOpen` moves the chin by 1 to 5 cm, whichever axis of the object points up.
    down = np.linalg.norm(jaw - rest, axis=1).max() * ob.matrix_world.median_scale
    assert 0.01 < down < 0.05
    assert addon("command").main(words) == 5, "the artist has keys of these names now"


def test_landmarks_are_stored_and_written(addon, tmp_path):
    import_head()
    out, save = tmp_path / "l.json", tmp_path / "o.blend"
    words = ["landmarks", "--object", "Head", "--out", str(out), "--save", str(save)]
    assert addon("command").main(words) == 0
    rows = json.loads(out.read_text())["landmarks"]
    assert [row["index"] for row in rows] == list(range(68))
    bpy.ops.wm.open_mainfile(filepath=str(save))
    stored = addon("scene.face.landmarks").load(bpy.data.objects["Head"])
    assert stored.sure > 0.5
    assert stored.positions[30] == pytest.approx(rows[30]["position"], abs=1e-6)


def points(block):
    """Positions `[V, 3]` of a shape key."""
    flat = np.empty(len(block.points) * 3, dtype=np.float32)
    block.points.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def test_what_a_process_that_was_killed_while_saving_has_left_goes(addon, tmp_path):
    left = [tmp_path / name for name in (".a.anyface-vm-7.blend", ".a.anyface-vm-8.blend@")]
    others = [tmp_path / name for name in ("a.blend", ".b.anyface-vm-7.blend", "a.anyface.blend")]
    for path in (*left, *others):
        path.write_bytes(b"")
    addon("core.beside").remove_all(str(tmp_path / "a.blend"))
    assert sorted(tmp_path.iterdir()) == sorted(others)
