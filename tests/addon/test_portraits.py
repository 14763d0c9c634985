"""Pictures of every emotion on a face, and takes of mixtures, with the extension's own library."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

import test_emotion_of
from figures import SETTINGS, film, grid, link_from_library, select, shape, stand_in
from test_heads import LANDMARKS, import_head

SIX = ("happy", "sad", "angry", "surprised", "disgusted", "afraid")
START = 1


@pytest.fixture(autouse=True)
def no_pictures(addon):
    """Deletes the pictures that were drawn before."""
    folder = addon("ui.preferences").cache_folder() / "emotions"
    shutil.rmtree(folder, ignore_errors=True)
    yield
    addon("ui.pictures")._shown.clear()


@pytest.fixture
def head():
    """The default head, selected."""
    ob = import_head()
    select(ob)
    return ob


@pytest.fixture
def pictures(addon):
    """`pictures(ob)` gives the pixels `[128, 128, 4]` of the picture of each emotion, by name."""

    def read(ob):
        shown = addon("ui.pictures").of(ob)
        return {path.stem: pixels(path) for path in sorted(shown.folder.glob("*.png"))}

    return read


def pixels(path):
    """A picture in 0..1, as Blender reads it."""
    image = bpy.data.images.load(str(path))
    values = np.array(image.pixels[:], dtype=np.float32).reshape(*image.size, 4)
    bpy.data.images.remove(image)
    return values


def draw():
    """Presses the button."""
    assert bpy.ops.anyface.draw_emotions() == {"FINISHED"}


def changed(monkeypatch, addon):
    """A list that gets the request of every `animate` call from now on."""
    calls, engine = [], addon("core.native").Engine
    animate = engine.animate

    def counted(self, *arguments):
        calls.append(arguments[5])
        return animate(self, *arguments)

    monkeypatch.setattr(engine, "animate", counted)
    return calls


def test_six_emotions_have_pictures_that_differ(head, pictures):
    draw()
    drawn = pictures(head)
    assert set(SIX) < set(drawn) and len(drawn) == 15
    for name in SIX:
        assert drawn[name].shape == (128, 128, 4)
        # The face fills the picture, and is not flat.
        assert drawn[name][..., 3].mean() > 0.5 and drawn[name][64, :, 0].std() > 0.05
    pairs = [(a, b) for a in ("neutral", *SIX) for b in SIX if a < b]
    for a, b in pairs:
        assert np.abs(drawn[a] - drawn[b]).max() > 0.2, (a, b)


def test_pictures_are_drawn_once(addon, head, pictures, monkeypatch):
    calls = changed(monkeypatch, addon)
    draw()
    drawn, folder = pictures(head), addon("ui.pictures").of(head).folder
    times = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    draw()
    assert len(calls) == 1
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == times
    # A file that is opened again finds its pictures, too.
    path = bpy.app.tempdir + "head.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    ob = bpy.data.objects["Head"]
    select(ob)
    assert addon("ui.pictures").of(ob) is None
    draw()
    assert len(calls) == 1 and addon("ui.pictures").of(ob).folder == folder
    # A picture that is lost is drawn again.
    (folder / "happy.png").unlink()
    draw()
    assert len(calls) == 2
    assert np.array_equal(pictures(ob)["happy"], drawn["happy"])


def test_another_mesh_or_intensity_is_drawn_anew(addon, head, pictures, monkeypatch):
    calls = changed(monkeypatch, addon)
    draw()
    full = pictures(head)
    head.anyface.intensity = 0.5
    draw()
    half = pictures(head)
    way = {
        name: np.abs(drawn["happy"] - drawn["neutral"]).mean()
        for name, drawn in (("full", full), ("half", half))
    }
    assert 0.2 * way["full"] < way["half"] < 0.8 * way["full"]
    head.anyface.intensity = 1.0
    nose = head.data.vertices[LANDMARKS[30]["vertex"]]
    nose.co += nose.normal * 0.01
    head.data.update()
    draw()
    assert len(calls) == 3
    assert np.abs(pictures(head)["happy"] - full["happy"]).max() > 0.1
    # Settings that only affect takes are no reason to draw again.
    head.anyface.seed, head.anyface.head_motion, head.anyface.emotion = 7, 0.3, "sad"
    draw()
    assert len(calls) == 3


def test_the_choice_shows_pictures_and_sets_the_emotion(addon, head):
    settings = head.anyface
    module = addon("ui.pictures")
    assert {icon for *_, icon, _ in module.items(settings, bpy.context)} == {0}
    assert settings.emotion_face == "neutral"
    draw()
    items = module.items(settings, bpy.context)
    # Without a window Blender gives pictures no icon numbers, but it still reads them.
    if not bpy.app.background:
        assert len({icon for *_, icon, _ in items} - {0}) == 15
    folder = module.of(head).folder
    sizes = [tuple(module._previews[f"{folder.name} {name}"].image_size) for name in SIX]
    assert sizes == [(128, 128)] * 6
    assert [name for name, *_ in items] == list(addon("core.emotion").EMOTIONS)
    settings.emotion_face = "sad"
    assert settings.emotion == "sad" and settings.emotion_face == "sad"


def test_every_face_has_its_own_pictures(addon, head):
    draw()
    other = head.copy()
    other.data = head.data.copy()
    bpy.context.collection.objects.link(other)
    module = addon("ui.pictures")
    assert module.of(other) is None
    for vertex in other.data.vertices:
        vertex.co.x *= 1.2
    select(other)
    draw()
    assert module.of(other).folder != module.of(head).folder


def test_nothing_in_the_file_changes(head):
    def state():
        return [
            sorted(set(head.keys()) - SETTINGS),
            head.data.shape_keys,
            len(bpy.data.images),
            len(bpy.data.meshes),
            len(bpy.data.objects),
        ]

    before = state()
    draw()
    assert state() == before


def test_a_linked_face_and_an_override_are_drawn(addon, head, tmp_path):
    linked = link_from_library("Head", tmp_path)
    select(linked)
    draw()
    assert addon("ui.pictures").of(linked) is not None
    ob = linked.override_create(remap_local_usages=True)
    select(ob)
    draw()
    assert addon("ui.pictures").of(ob).folder == addon("ui.pictures").of(linked).folder
    ob.anyface.emotion_face = "angry"
    assert ob.anyface.emotion == "angry"
    assert ob.anyface.is_property_overridable_library("emotion_face")
    shot = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    bpy.ops.wm.open_mainfile(filepath=shot)
    (ob,) = [ob for ob in bpy.data.objects if ob.override_library is not None]
    assert ob.anyface.emotion == ob.anyface.emotion_face == "angry"


def test_what_has_no_face_is_told_and_the_next_one_is_drawn(addon, head):
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(RuntimeError, match="Cube"):
        bpy.ops.anyface.draw_emotions()
    assert addon("ui.pictures").of(bpy.context.object) is None
    select(head)
    draw()


def test_a_job_that_is_cancelled_leaves_no_half_set(addon, head, tmp_path):
    portraits = addon("ui.emotions")._portraits(head)
    progress = addon("core.job").Progress()
    progress.cancel()
    with pytest.raises(addon("core.errors").Cancelled):
        portraits.work(progress)
    assert not portraits.are_drawn
    portraits.work(addon("core.job").Progress())
    assert portraits.are_drawn and {path.suffix for path in portraits.folder.iterdir()} == {".png"}


def test_old_pictures_go(addon, tmp_path):
    module = addon("core.portraits")
    for number in range(module._KEPT + 5):
        folder = tmp_path / f"{number:03d}"
        folder.mkdir()
        os.utime(folder, (number, number))
    module._forget(tmp_path, tmp_path / "000")
    left = sorted(path.name for path in tmp_path.iterdir())
    assert len(left) == module._KEPT and left[0] == "000" and left[1] == "006"


def cube(hollow):
    """Points and triangles of a cube from -1 to 1; a hollow one has no front."""
    points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    sides = [(0, 2, 6, 4), (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6)]
    sides += [] if hollow else [(1, 5, 7, 3)]
    return points, np.array([[a, b, c] for a, b, c, d in sides for b, c in ((b, c), (c, d))])


def test_a_picture_shows_what_is_in_front_and_the_inside_dark(addon):
    picture = addon("core.picture")
    view = picture.View(0.0, 0.0, 2.0)
    drawn = {}
    for hollow in (False, True):
        points, faces = cube(hollow)
        drawn[hollow] = picture.draw(points, faces, view, 64)
        assert drawn[hollow].shape == (64, 64, 4) and drawn[hollow].dtype == np.uint8
        # The cube fills half of the picture's width and half of its height.
        assert drawn[hollow][17:47, 17:47, 3].min() == 255
        assert drawn[hollow][:15, :, 3].max() == 0 and drawn[hollow][:, 49:, 3].max() == 0
        # With all triangles turned inside out it looks the same.
        assert np.array_equal(drawn[hollow], picture.draw(points, faces[:, ::-1], view, 64))
    front, inside = (drawn[hollow][20:44, 20:44, 0].mean() for hollow in (False, True))
    assert inside < 0.4 * front
    # The picture is about the centre of the view.
    aside = picture.draw(*cube(True), picture.View(0.5, -0.75, 2.0), 64)
    points, faces = cube(True)
    moved = picture.draw(points - [0.5, -0.75, 0.0], faces, view, 64)
    assert np.array_equal(aside, moved) and not np.array_equal(aside, drawn[True])
    # A small, nearer cube in the middle hides the part of the large cube behind it.
    points, faces = cube(False)
    small = 0.5 * points + [0.0, 0.0, 3.0]
    both = picture.draw(
        np.concatenate([small, points]), np.concatenate([faces, faces + 8]), view, 64
    )
    alone = picture.draw(small, faces, view, 64)
    assert np.array_equal(both[26:38, 26:38], alone[26:38, 26:38])
    assert np.array_equal(both[17:23, 17:23], drawn[False][17:23, 17:23])
    # The upper left of the cube is lighter than its lower right.
    assert drawn[False][20, 20, 0] > drawn[False][44, 44, 0]


def test_a_png_holds_the_pixels(addon, tmp_path):
    random_pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    random_pixels[..., 3] = 255
    path = Path(tmp_path / "made.png")
    path.write_bytes(addon("core.picture").png(random_pixels))
    image = bpy.data.images.load(str(path))
    assert tuple(image.size) == (7, 5)
    read = np.array(image.pixels[:]).reshape(5, 7, 4)[::-1]
    assert np.abs(read * 255.0 - random_pixels).max() < 1.0


def test_a_stage_without_life_is_told(addon):
    """If the drawing fails, the artist is told and no picture is shown."""
    stand_in(addon)
    grid()
    with pytest.raises(RuntimeError):
        bpy.ops.anyface.draw_emotions()
    assert addon("ui.pictures").of(bpy.context.object) is None


@pytest.fixture
def speaking(head, tmp_path):
    """The default head with a voice and no random motion."""
    settings = head.anyface
    settings.source, settings.start_frame = "FILE", START
    settings.sound_file = test_emotion_of.voice(tmp_path / "voice.wav", 110.0, 0.02)
    settings.error_mm, settings.blinks_per_minute = 0.05, 0.0
    settings.brow_accents = settings.variety = settings.gaze = 0.0
    return head


def generate(ob):
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report


def film_of_mixture(ob, text):
    """Some frames `[N, V, 3]` of a take with this mixture."""
    (first, weight), *others = (item.split(":") for item in text.split(","))
    ob.anyface.emotion, ob.anyface.intensity = first, float(weight)
    ob.anyface.mixture.clear()
    for name, weight in others:
        row = ob.anyface.mixture.add()
        row.emotion, row.weight = name, float(weight)
    generate(ob)
    return film(ob, range(START + 20, START + 40, 5))


def largest_mm(moved):
    return 1000.0 * float(np.linalg.norm(moved, axis=2).max())


def test_a_mixture_lies_near_the_sum_of_its_emotions(speaking):
    calm = film_of_mixture(speaking, "neutral:1")
    first, second = (
        film_of_mixture(speaking, f"{name}:0.5") - calm for name in ("happy", "surprised")
    )
    both = film_of_mixture(speaking, "happy:0.5,surprised:0.5") - calm
    assert largest_mm(both - first) > 3.0 and largest_mm(both - second) > 3.0
    left = np.linalg.norm(both - first - second) / np.linalg.norm(both)
    assert left < 0.25, left


def test_a_batch_makes_the_same_of_the_mixture(speaking, installed, tmp_path):
    here = film_of_mixture(speaking, "happy:0.6,sad:0.6")
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    shot, out = (str(tmp_path / name) for name in ("shot.blend", "out.blend"))
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    script = str(installed / "anyface_batch.py")
    command = [sys.executable, script, shot, "bake", "--object", "Head"]
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "empty")}
    takes = []
    for more in ((), ("--emotion", "happy:0.6,sad:0.6"), ("--emotion", "happy:0.6")):
        words = [*command, "--save", out, *more]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        bpy.ops.wm.open_mainfile(filepath=out)
        takes.append(film(bpy.data.objects["Head"], range(START + 20, START + 40, 5)))
    stored, requested, happy = takes
    assert largest_mm(stored - here) < 0.02 and largest_mm(requested - here) < 0.02
    assert largest_mm(happy - here) > 1.0


def test_keyframes_on_a_weight_move_the_face_over_time(speaking):
    corner = [LANDMARKS[48]["vertex"]]
    film_of_mixture(speaking, "calm:0.3,happy:0.0")
    still = [shape(speaking, frame)[corner] for frame in (START + 2, START + 44)]
    for frame, value in ((START, 0.0), (START + 30, 1.0)):
        speaking.anyface.mixture[0].weight = value
        speaking.keyframe_insert("anyface.mixture[0].weight", frame=frame)
    generate(speaking)
    keyed = [shape(speaking, frame)[corner] for frame in (START + 2, START + 44)]
    far = [1000.0 * float(np.linalg.norm(a - b)) for a, b in zip(keyed, still, strict=True)]
    assert far[0] < 1.0 and far[1] > 4.0, far
