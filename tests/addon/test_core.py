"""Parts that need no Blender, as installed from the zip."""

import ast
import io
import json
import time

import numpy as np
import pytest

from conftest import ROOT


def test_core_and_farm_never_import_bpy(installed):
    paths = sorted([*(installed / "core").rglob("*.py"), *(installed / "farm").rglob("*.py")])
    assert len(paths) > 10
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            assert not any(name.split(".")[0] in ("bpy", "aud") for name in names), path


def test_the_licences_of_what_is_linked_lie_in_the_zip(installed):
    names = ["LICENSE-APACHE", "LICENSE-MIT", "NOTICE", "THIRD-PARTY.md"]
    assert sorted(path.name for path in (installed / "licences").iterdir()) == names
    for name in names:
        assert (installed / "licences" / name).read_bytes() == (ROOT / name).read_bytes(), name


def _matrix(rotation, scale):
    matrix = np.eye(4)
    matrix[:3, :3] = rotation @ np.diag(scale)
    matrix[:3, 3] = (1.0, -2.0, 3.0)
    return matrix


def _about_z(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("scale", [(2.0, 0.5, 1.5), (0.01, 0.01, 0.01), (-1.0, 1.0, 1.0)])
@pytest.mark.parametrize("axes", ["WORLD", "LOCAL", "LOCAL_Y_UP"])
def test_displacements_come_back_to_object_space(addon, scale, axes):
    space = addon("core.space").face_space(_matrix(_about_z(35), scale), axes)
    points = np.random.default_rng(1).normal(size=(20, 3))
    moved = points + 0.1
    there = space.points(moved) - space.points(points)
    assert np.allclose(space.to_object(there), 0.1, atol=1e-3)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (-1.0, 1.0, 1.0)])
def test_local_axes_undo_the_turn_of_the_object(addon, scale):
    space = addon("core.space").face_space(_matrix(_about_z(120), scale), "LOCAL")
    assert np.allclose(space.matrix, np.diag(scale), atol=1e-6)
    assert space.mirrored == (scale[0] < 0)


def test_flat_objects_are_refused(addon):
    with pytest.raises(Exception, match="scaled to zero"):
        addon("core.space").face_space(_matrix(np.eye(3), (1.0, 0.0, 1.0)), "WORLD")


def test_emotions_are_read_and_checked(addon):
    emotion = addon("core.emotion")
    row = emotion.parse("happy:0.4, surprised:0.3")
    assert row[1] == 0.4 and row[4] == 0.3 and sum(row) == pytest.approx(0.7)
    for text in ("joyful:1", "happy:x", "happy:-1", "happy:1,sad:1", "happy:nan"):
        with pytest.raises(addon("core.errors").AnyfaceError) as caught:
            emotion.parse(text)
        assert caught.value.exit_code == 3


def test_silence_is_named_as_the_reason(addon):
    verdict, take = addon("core.verdict"), addon("core.take")
    silent = take.Sound(np.zeros(16000, dtype=np.float32), 16000, "Voice")
    with pytest.raises(addon("core.errors").AnyfaceError, match=r"Voice is silent.*1\.00 s"):
        verdict.check_sound(silent)
    quiet = take.Sound(np.full(16000, 0.003, dtype=np.float32), 16000, "Voice")
    with pytest.raises(addon("core.errors").AnyfaceError, match="very quiet"):
        verdict.check_seen(take.Animation(0.01, "NOTHING"), quiet, 0.0)
    with pytest.raises(addon("core.errors").AnyfaceError, match="nothing moved but lids and brows"):
        verdict.check_seen(take.Animation(5.0, "LIPS_REST"), quiet, 1.0)
    verdict.check_seen(take.Animation(1.0), quiet, 0.0)


def test_job_reports_cancels_and_fails_in_words(addon):
    job = addon("core.job")
    assert job.Job(lambda progress: 7).start().result() == 7

    def endless(progress):
        while True:
            progress.check("motion", 0.25)
            time.sleep(0.001)

    running = job.Job(endless).start()
    running.cancel(wait_s=5.0)
    assert running.done and running.progress.at == ("motion", 0.25)
    with pytest.raises(addon("core.errors").Cancelled):
        running.result()
    failing = job.Job(lambda progress: [][1]).start()
    with pytest.raises(addon("core.errors").AnyfaceError, match="IndexError"):
        failing.result()


def test_a_face_that_was_not_found_is_named_with_the_reason_first(addon):
    perform, take, errors = addon("core.perform"), addon("core.take"), addon("core.errors")
    corners = np.array([[0, 1, 2]], np.uint32)
    face = take.FaceMesh("Head", np.eye(3, dtype=np.float32), corners, np.eye(4))
    face.hints = ["Half of the face comes from a Mirror modifier: apply it"]

    def nowhere(*_):
        raise errors.AnyfaceError("face", "no face found: nothing like a nose")

    sound = take.Sound(np.ones(1600, dtype=np.float32), 16000, "Voice")
    ask = (face, sound, take.Request(24.0, error_mm=None))
    words = r"^Head: Half .*apply it\. no face .*Place Points asks for the five"
    with pytest.raises(errors.AnyfaceError, match=words) as caught:
        perform.perform(*ask, nowhere, addon("core.job").Progress())
    assert caught.value.mends == ("place_points", "direction", "points_file", "apply_mirror")


def test_weights_are_loaded_by_the_first_who_needs_them_and_once(addon):
    engines = []

    class Engine:
        closed = False

        def find(self):
            return "found"

        def close(self):
            self.closed = True

    def load():
        engines.append(Engine())
        return engines[-1]

    lazy = addon("core.lazy").LazyEngine(load)
    lazy.close()
    assert not engines and not lazy.is_loaded
    assert [lazy.find(), lazy.find()] == ["found", "found"] and len(engines) == 1
    lazy.close()
    assert engines[0].closed and not lazy.is_loaded


def test_nothing_that_is_printed_steers_a_terminal(addon):
    stream = io.StringIO()
    addon("core.errors").say("Kopf\t頭: \x1b]0;title\x07\r\x9b31m\u202egpj", stream)
    assert stream.getvalue() == "Kopf\t頭: \\u001b]0;title\\u0007\\u000d\\u009b31m\\u202egpj\n"


def test_no_text_of_a_row_leaves_the_script_of_the_page(addon, tmp_path):
    names = ["<!--<script>", "</script><img src=x onerror=alert(1)>", "<"]
    reports = [{"name": name, "ok": True, "message": name} for name in names]
    addon("farm.results").write(tmp_path, reports, 1.0)
    page = (tmp_path / "results.html").read_text(encoding="utf-8")
    template = (addon("farm.export").templates() / "results.html").read_text(encoding="utf-8")
    assert page.count("<") == template.count("<")
    before, after = template.split("{{ROWS}}")
    rows = json.loads(page.removeprefix(before).removesuffix(after))
    assert sorted(row["name"] for row in rows) == sorted(names)
