"""The installed extension with its own library on real heads: sound in, picture out."""

import json
import os
import re
import shutil
import subprocess
import sys
import wave
from pathlib import Path

import bpy
import numpy as np
import pytest

from conftest import ROOT
from figures import everything, film, shape, write_wav

HEAD = ROOT / "weights" / "shared" / "default_head" / "head.obj"
LANDMARKS = json.loads((HEAD.parent / "landmarks.json").read_text())["landmarks"]
SUZANNE = ROOT / "packaging" / "demo" / "suzanne_landmarks.json"
SENTENCE = "Papa saw a large ball far away."
# The sentence begins at this time. There is as much silence before it as after it.
SILENCE_S = 0.7


@pytest.fixture(scope="module")
def voice(tmp_path_factory):
    """A spoken sentence between two pauses: path, samples, rate."""
    folder = tmp_path_factory.mktemp("voice")
    spoken, path = folder / "spoken.wav", folder / "voice.wav"
    if shutil.which("flite"):
        command = ["flite", "-voice", "slt", "-t", SENTENCE, "-o", str(spoken)]
    elif shutil.which("espeak-ng"):
        command = ["espeak-ng", "-w", str(spoken), SENTENCE]
    else:
        pytest.skip("no flite and no espeak-ng to speak")
    subprocess.run(command, check=True)
    with wave.open(str(spoken), "rb") as file:
        rate = file.getframerate()
        data = np.frombuffer(file.readframes(file.getnframes()), dtype="<i2") / 32768.0
    pause = np.zeros(int(SILENCE_S * rate))
    samples = np.concatenate([pause, data, pause])
    write_wav(path, samples, rate)
    return str(path), samples, rate


def import_head():
    """The default head as Blender imports it: in metres, and the object holds the rotation."""
    bpy.ops.wm.obj_import(filepath=str(HEAD), use_split_objects=False, use_split_groups=False)
    ob = bpy.context.object
    ob.name = "Head"
    bpy.context.view_layer.update()
    return ob


def ready(ob, path):
    """Sets a sound file that starts at frame 1, at 24 frames a second."""
    bpy.context.scene.render.fps = 24
    bpy.context.view_layer.objects.active = ob
    ob.anyface.source, ob.anyface.sound_file, ob.anyface.start_frame = "FILE", path, 1
    return ob


def loudest_s(samples, rate):
    """The middle of the loudest tenth of a second: a vowel."""
    width = int(0.1 * rate)
    energy = np.convolve(samples**2, np.ones(width), mode="same")
    return float(np.argmax(energy)) / rate


def lip_gap(ob, points):
    """Distance of the inner lips (landmarks 62 and 66), object units."""
    top, bottom = (LANDMARKS[n]["vertex"] for n in (62, 66))
    return float(np.linalg.norm(points[top] - points[bottom]))


def test_the_default_head_speaks(voice):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    before = everything()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    vowel = shape(ob, 1 + loudest_s(samples, rate) * 24)
    pause = shape(ob, 1 + SILENCE_S * 0.5 * 24)
    assert lip_gap(ob, vowel) > lip_gap(ob, pause) + 0.003
    error_mm = float(re.search(r"exact to ([\d.]+) mm", ob.anyface.report_details)[1])
    assert 0.0 < error_mm <= ob.anyface.error_mm
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert everything() == before


def test_basis_and_frames_show_the_same_motion(voice):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    frame = 1 + round(loudest_s(samples, rate) * 24)
    # Curves with few keys would add a tolerance of their own.
    ob.anyface.curves = "EVERY"
    bpy.ops.anyface.generate()
    basis = shape(ob, frame)
    ob.anyface.mode = "frames"
    bpy.ops.anyface.generate()
    error = np.linalg.norm(shape(ob, frame) - basis, axis=1).max()
    # 0.1 mm at human size; the default head is a little smaller or larger than the mean one.
    assert 0.0 < error < 0.00015


def lid_gap(points):
    """Distance of the lids (landmarks 37, 38 and 41, 40) of the right eye, object units."""
    lids = np.array([[LANDMARKS[n]["vertex"] for n in pair] for pair in ((37, 41), (38, 40))])
    return float(np.linalg.norm(points[lids[:, 0]] - points[lids[:, 1]], axis=1).mean())


def test_sliders_do_what_they_say_without_a_new_run(voice):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    ob.anyface.emotion, ob.anyface.intensity, ob.anyface.blinks_per_minute = "happy", 0.8, 60.0
    rest = shape(ob, 1)
    bpy.ops.anyface.generate()
    settings, ids = ob.anyface_output, [row["vertex"] for row in LANDMARKS]
    last = round((len(samples) / rate) * 24)
    film = [shape(ob, frame) for frame in range(1, last)]
    blink = 1 + int(np.argmin([lid_gap(points) for points in film]))
    closed, mouth = film[blink - 1], ids[48:68]
    assert lid_gap(closed) < 0.5 * lid_gap(rest)
    settings.closing = 0.0
    opened = shape(ob, blink)
    # A happy face raises its lower lids.
    assert lid_gap(opened) > 0.65 * lid_gap(rest)
    # Curves of few keys keep a take within 0.2 mm.
    assert np.linalg.norm(opened - closed, axis=1)[mouth].max() < 0.0002
    settings.closing = 1.0
    vowel = 1 + round(loudest_s(samples, rate) * 24)
    gaps, wide = [], []
    for settings.articulation in (0.5, 1.0, 1.5):
        gaps.append(lip_gap(ob, shape(ob, vowel)))
    settings.articulation = 1.0
    for settings.emotion in (0.0, 0.5, 1.0):
        corners = shape(ob, vowel)[[ids[48], ids[54]]]
        wide.append(float(np.linalg.norm(corners[0] - corners[1])))
    assert gaps[1] - gaps[0] > 0.001 and gaps[2] - gaps[1] > 0.001
    assert wide[1] - wide[0] > 0.001 and wide[2] - wide[1] > 0.001


def test_sliders_come_near_to_a_new_run(voice):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    ob.anyface.emotion, ob.anyface.intensity = "happy", 0.8
    # Curves with few keys would add a tolerance of their own.
    ob.anyface.curves = "EVERY"
    bpy.ops.anyface.generate()
    frames = range(1, round(len(samples) / rate * 24), 5)
    original = film(ob, frames)
    ob.anyface_output.articulation, ob.anyface_output.emotion = 1.3, 0.5
    moved = film(ob, frames)
    ob.anyface.articulation, ob.anyface.intensity = 1.3, 0.4
    bpy.ops.anyface.generate()
    assert ob.anyface_output.articulation == ob.anyface_output.emotion == 1.0
    anew = film(ob, frames)
    left, way = (np.linalg.norm(anew - other, axis=2) for other in (moved, original))
    # A new run moves vertices by 6 mm. docs/blender-takes.md says how much of that sliders miss.
    assert way.max() > 0.004 and left.max() < 0.0011 and left.mean() < 0.00012


@pytest.mark.parametrize("mode", ["arkit", "keys"])
def test_arkit_keys_show_the_performance(voice, mode):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    frame = 1 + round(loudest_s(samples, rate) * 24)
    bpy.ops.anyface.generate()
    basis = shape(ob, frame)
    ob.anyface.mode = "arkit"
    bpy.ops.anyface.generate()
    if mode == "keys":
        ob.anyface.mode = "arkit"
        action = ob.data.shape_keys.animation_data.action
        ob.data.shape_keys.animation_data_clear()
        bpy.data.actions.remove(action)
        del ob.data.shape_keys["anyface"]
        ob.anyface.mode = "keys"
        bpy.ops.anyface.generate()
    gap, expected = lip_gap(ob, shape(ob, frame)), lip_gap(ob, basis)
    assert abs(gap - expected) < 0.004
    shown = int(re.search(r"of the motion \((\d+) %\)", ob.anyface.report)[1])
    assert shown > 50


def ball(places):
    """A ball whose face is keys alone, each of which moves a patch of it; it has no mouth."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=0.12)
    ob = bpy.context.object
    ob.shape_key_add(name="Basis")
    for name, (x, z) in places.items():
        key = ob.shape_key_add(name=name)
        for number, vertex in enumerate(ob.data.vertices):
            if vertex.co.y < 0.0 and abs(vertex.co.x - x) < 0.03 and abs(vertex.co.z - z) < 0.02:
                key.data[number].co.z -= 0.005
    return ob


@pytest.mark.parametrize("system", ["freetalk", "cafe-talk"])
def test_a_face_of_keys_alone_follows_the_sample_head(voice, system):
    ob = ready(ball(dict.fromkeys("AIUEO", (0.0, -0.05)) | {"blink_L": (0.04, 0.03)}), voice[0])
    ob.anyface.mode, ob.anyface.system = "keys", system
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert "no face was found" in ob.anyface.report
    peaks = dict.fromkeys("AIUEO", 0.0)
    blocks = ob.data.shape_keys.key_blocks
    for frame in range(1, ob.anyface.last_frame):
        bpy.context.scene.frame_set(frame)
        peaks = {name: max(peak, blocks[name].value) for name, peak in peaks.items()}
    assert max(peaks.values()) > 0.3 and sum(peak > 0.1 for peak in peaks.values()) > 1
    with pytest.raises(RuntimeError, match="no face found"):
        ob.anyface.mode = "basis"
        bpy.ops.anyface.generate()


def test_a_table_is_live_link_face(voice, tmp_path):
    ob = ready(import_head(), voice[0])
    ob.anyface.mode, ob.anyface_output.csv_file = "csv", str(tmp_path / "face.csv")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    rows = [line.split(",") for line in (tmp_path / "face.csv").read_text().splitlines()]
    assert rows[0][:3] == ["Timecode", "BlendShapeCount", "EyeBlinkLeft"]
    jaw = [float(row[rows[0].index("JawOpen")]) for row in rows[1:]]
    assert max(jaw) > 0.05 and {len(row) for row in rows} == {63}
    assert ob.data.shape_keys is None


def test_units_and_rotation_change_nothing(voice):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    frame = 1 + round(loudest_s(samples, rate) * 24)
    bpy.ops.anyface.generate()
    plain = shape(ob, frame) - shape(ob, -20)
    bpy.ops.anyface.remove()
    bpy.context.scene.frame_set(1)
    ob.scale, ob.location = (100.0,) * 3, (5.0, -3.0, 160.0)
    ob.rotation_euler.z = 1.0
    bpy.context.view_layer.update()
    bpy.ops.anyface.generate()
    other = shape(ob, frame) - shape(ob, -20)
    assert np.linalg.norm(plain, axis=1).max() > 0.003
    assert np.linalg.norm(other - plain, axis=1).max() < 0.0005


def test_the_emotion_reaches_the_motion(voice):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    faces = []
    for emotion in ("neutral", "happy"):
        ob.anyface.emotion = emotion
        bpy.ops.anyface.generate()
        faces.append(shape(ob, 1 + round(loudest_s(samples, rate) * 24)))
    corner = LANDMARKS[48]["vertex"]
    assert np.linalg.norm(faces[0][corner] - faces[1][corner]) > 0.003


def test_suzanne_is_found():
    bpy.ops.mesh.primitive_monkey_add(rotation=(0.4, -0.3, 1.0), location=(1, 2, 3), size=0.3)
    ob = bpy.context.object
    assert bpy.ops.anyface.find_face() == {"FINISHED"}
    rows = json.loads(ob["anyface_landmarks"])["landmarks"]
    truth = np.array(json.loads(SUZANNE.read_text())) * 0.15
    height = np.linalg.norm(truth[8] - truth[[19, 24]].mean(0))
    off = (np.array([row["position"] for row in rows]) - truth) / height
    # Suzanne's mouth is a pit. Beside its rim the surface lies deeper, so depth says little there.
    across, miss = np.linalg.norm(off[:, [0, 2]], axis=1), np.linalg.norm(off, axis=1)
    assert across[48:68].mean() < 0.045, f"mouth {across[48:68].mean():.3f} seen from the front"
    assert miss[48:68].mean() < 0.06, f"mouth {miss[48:68].mean():.3f} of the face's height"
    assert miss[36:48].mean() < 0.05, f"eyes {miss[36:48].mean():.3f} of the face's height"


def test_suzanne_speaks_with_given_landmarks(voice):
    bpy.ops.mesh.primitive_monkey_add()
    ob = ready(bpy.context.object, voice[0])
    ob["anyface_landmarks"] = SUZANNE.read_text()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    rest, moved = shape(ob, -20), shape(ob, 1 + round(loudest_s(*voice[1:]) * 24))
    assert np.linalg.norm(moved - rest, axis=1).max() > 0.01


HISS = pytest.param(
    np.random.default_rng(0).normal(size=48000) * 0.03,
    marks=pytest.mark.xfail(
        strict=True, reason="at some moments the ear takes white noise for speech"
    ),
)


@pytest.mark.parametrize(
    "samples", [0.5 * np.sin(np.arange(48000) * 0.0864), HISS], ids=["tone", "hiss"]
)
def test_blinks_under_what_is_no_voice_are_no_speech(tmp_path, samples):
    path = tmp_path / "hiss.wav"
    write_wav(path, samples, 16000)
    ob = ready(import_head(), str(path))
    before = everything()
    with pytest.raises(RuntimeError, match=r"nothing moved but lids and brows.*hiss\.wav"):
        bpy.ops.anyface.generate()
    assert ob.anyface.report_is_error and everything() == before
    ob.anyface.articulation = 0.0
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def test_find_face_says_what_it_found(addon):
    ob = import_head()
    assert bpy.ops.anyface.find_face() == {"FINISHED"}
    text, icon = addon("ui.character").status(ob)
    assert text.startswith("face found, ") and "the lips part" in text
    assert icon == "CHECKMARK"
    places = addon("scene.face.landmarks").load(ob).positions
    truth = np.array([row["position"] for row in LANDMARKS])
    assert np.linalg.norm(places - truth, axis=1).mean() < 0.005
    roles = {row.found for row in ob.anyface_face.loose}
    assert "skin" in roles


def test_a_dragged_landmark_stays_and_its_neighbours_follow(addon):
    ob = import_head()
    bpy.ops.anyface.find_face()
    landmarks = addon("scene.face.landmarks")
    sure, before = landmarks.load(ob).sure, landmarks.load(ob).positions
    target = before[48] + (before[48] - before[54]) * 0.2
    bpy.ops.anyface.move_landmark(number=48, place=target)
    after = landmarks.load(ob)
    assert after.fixed == {48} and after.sure >= sure
    goal = landmarks.Surface(ob).nearest(target)
    assert np.linalg.norm(after.positions[48] - goal) < 1e-3
    away = np.linalg.norm(after.positions - before, axis=1)
    assert away[60] > 0.2 * away[48] and away[48] > 0.005
    assert away[17] < 0.5 * away[60]


def test_a_keyed_slider_changes_the_motion_over_time(voice):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    bpy.ops.anyface.generate()
    frames = [1 + SILENCE_S * 24 + n for n in range(int((len(samples) / rate - 1.4) * 24))]
    corner = [LANDMARKS[n]["vertex"] for n in (57, 66)]

    def moved():
        rest = shape(ob, -20)[corner]
        return np.array([np.linalg.norm(shape(ob, f)[corner] - rest, axis=1).max() for f in frames])

    plain = moved()
    for frame, value in ((1, 0.0), (frames[-1], 1.0)):
        ob.anyface.articulation = value
        ob.keyframe_insert("anyface.articulation", frame=frame)
    bpy.ops.anyface.generate()
    keyed = moved()
    half = len(frames) // 2
    assert keyed[:half].sum() < 0.6 * plain[:half].sum()
    assert np.abs(keyed[-3:] - plain[-3:]).max() < 0.002


def test_a_cube_has_no_face(voice):
    bpy.ops.mesh.primitive_cube_add()
    ob = ready(bpy.context.object, voice[0])
    with pytest.raises(RuntimeError):
        bpy.ops.anyface.generate()
    assert ob.anyface.report_is_error and ob.data.shape_keys is None
    assert "anyface_landmarks" in ob.anyface.report or "mesh" in ob.anyface.report


def camera(ob):
    """Adds an orthographic camera, 256 by 256, and a light. Returns a map from points to pixels."""
    scene = bpy.context.scene
    points = np.array([row["position"] for row in LANDMARKS])
    world = [ob.matrix_world @ ob.data.vertices[row["vertex"]].co for row in LANDMARKS]
    centre = np.mean(world, axis=0)
    width = 1.3 * np.ptp(points[:, 0])
    view = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    view.data.type, view.data.ortho_scale = "ORTHO", width
    view.location = (centre[0], centre[1] - 2.0, centre[2])
    view.rotation_euler = (np.pi / 2, 0.0, 0.0)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler, sun.data.energy = (1.2, 0.0, 0.3), 3.0
    for ob_new in (view, sun):
        scene.collection.objects.link(ob_new)
    scene.camera, scene.render.engine = view, "CYCLES"
    scene.cycles.samples, scene.cycles.device, scene.cycles.use_denoising = 16, "CPU", False
    scene.render.resolution_x = scene.render.resolution_y = 256
    scene.render.image_settings.file_format = "PNG"

    def pixel(point):
        right, up = (point[0] - centre[0]) / width, (point[2] - centre[2]) / width
        return round((right + 0.5) * 256), round((0.5 - up) * 256)

    return pixel


def render(frame, path):
    """The picture of a frame, `[256, 256]` in 0..1."""
    from PIL import Image

    bpy.context.scene.frame_set(round(frame))
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return np.asarray(Image.open(path).convert("L"), dtype=np.float64) / 255.0


def test_a_rendered_vowel_differs_from_a_pause_at_the_mouth(voice, tmp_path):
    path, samples, rate = voice
    ob = ready(import_head(), path)
    bpy.ops.anyface.generate()
    pixel = camera(ob)
    folder = os.environ.get("ANYFACE_RENDERS", str(tmp_path))
    vowel = render(1 + loudest_s(samples, rate) * 24, f"{folder}/vowel.png")
    pause = render(1 + SILENCE_S * 0.5 * 24, f"{folder}/pause.png")
    mouth = [ob.matrix_world @ ob.data.vertices[LANDMARKS[n]["vertex"]].co for n in (48, 54, 8)]
    (left, top), (right, _), (_, bottom) = (pixel(point) for point in mouth)
    difference = np.abs(vowel - pause)
    at_mouth = difference[top - 12 : bottom, left:right].mean()
    top_of_head = difference[:40].mean()
    assert at_mouth > 0.01, f"mouth {at_mouth:.4f}, forehead {top_of_head:.4f}"
    assert at_mouth > 4.0 * top_of_head, f"mouth {at_mouth:.4f}, forehead {top_of_head:.4f}"


def test_the_batch_module_writes_a_file(installed, voice, tmp_path):
    import_head()
    shot, out, report = (str(tmp_path / name) for name in ("shot.blend", "out.blend", "r.json"))
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    words = ["--object", "Head", "--audio", voice[0], "--emotion", "happy:0.7"]
    words += ["--save", out, "--report", report]
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    environment["BLENDER_USER_RESOURCES"] = str(tmp_path / "empty")
    command = [sys.executable, "-m", "anyface_batch", shot, "bake", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "shape keys" in done.stdout
    assert json.loads(Path(report).read_text())["ok"]
    bpy.ops.wm.open_mainfile(filepath=out)
    blocks = bpy.data.objects["Head"].data.shape_keys.key_blocks
    assert "Anyface.jaw" in blocks
    command[4:5] = []
    command[command.index("Head")] = "Nobody"
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 3 and "Nobody" in done.stderr
