"""Faces moved by rigs: how much motion the output Rig Controls shows, and that it harms nothing."""

import os
import shutil
import subprocess
import wave

import bpy
import numpy as np
import pytest

import mpfb_face
import rigify_face
import rigs
from figures import curves, everything, film, write_wav

# The lips close often in this sentence: p, b and m.
SENTENCE = "Mama, please put my baby's blue book beside the big map."
PAUSE_S = 0.4


@pytest.fixture(scope="module")
def voice(tmp_path_factory):
    """The path of a spoken sentence between two pauses."""
    folder = tmp_path_factory.mktemp("voice")
    spoken, path = folder / "spoken.wav", folder / "voice.wav"
    if not shutil.which("flite"):
        pytest.skip("no flite to speak")
    subprocess.run(["flite", "-voice", "slt", "-t", SENTENCE, "-o", str(spoken)], check=True)
    with wave.open(str(spoken), "rb") as file:
        rate = file.getframerate()
        data = np.frombuffer(file.readframes(file.getnframes()), dtype="<i2") / 32768.0
    pause = np.zeros(int(PAUSE_S * rate))
    write_wav(path, np.concatenate([pause, data, pause]), rate)
    return str(path)


def ready(ob, path):
    """Sets a sound file that starts at frame 1, at 24 frames a second."""
    bpy.context.scene.render.fps = 24
    bpy.context.view_layer.objects.active = ob
    ob.anyface.source, ob.anyface.sound_file, ob.anyface.start_frame = "FILE", path, 1
    return ob


def frames_of(path):
    """The scene frames of the take."""
    with wave.open(path, "rb") as file:
        return range(1, 1 + int(np.ceil(file.getnframes() / file.getframerate() * 24)))


def truth(ob, path):
    """The motion that Anyface gives the bare mesh, `[T, V, 3]`. Removes the take again."""
    shown = [(m, m.show_viewport) for m in ob.modifiers]
    for modifier, _ in shown:
        modifier.show_viewport = False
    ob.anyface.mode = "frames"
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    moved = film(ob, frames_of(path)) - rigs.positions(ob)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    for modifier, was in shown:
        modifier.show_viewport = was
    return moved


def face_vertices(ob):
    """Vertices of the skin within 25 mm of a landmark."""
    points, marks = rigs.positions(ob), rigs.landmarks()
    away = np.linalg.norm(points[:, None] - marks[None], axis=2).min(axis=1)
    skin = np.zeros(len(points), dtype=bool)
    skin[: rigs.skin_vertices()] = True
    return np.flatnonzero((away < 0.025) & skin)


def share(ob, true, shown):
    """The share of the energy of the face's true motion that is shown."""
    some = face_vertices(ob)
    missed = ((true[:, some] - shown[:, some]) ** 2).sum()
    return 1.0 - missed / (true[:, some] ** 2).sum()


def gaps(ob, moved):
    """How much farther apart the inner lips are than at rest, `[T]`."""
    points = rigs.positions(ob) + moved
    top, bottom = (rigs.LANDMARKS[n]["vertex"] for n in (62, 66))
    apart = np.linalg.norm(points[:, top] - points[:, bottom], axis=1)
    rest = np.linalg.norm(rigs.positions(ob)[top] - rigs.positions(ob)[bottom])
    return apart - rest


def closed(ob, target, shown):
    """The share of the true lip closures at which the lips of the rig close too."""
    true, on_rig = gaps(ob, target), gaps(ob, shown)
    limit = 0.15 * np.quantile(true, 0.95)
    least = np.r_[False, (true[1:-1] <= true[:-2]) & (true[1:-1] < true[2:]), False]
    moments = np.flatnonzero(least & (true < limit))
    assert len(moments) >= 4
    return float((on_rig[moments] < limit).mean())


def speak(ob, path):
    """Generates on the controls. Returns the motion of the evaluated mesh."""
    ob.anyface.mode = "controls"
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    print(ob.anyface.report)
    frames = frames_of(path)
    rest = film(ob, [frames[0] - 30])[0]
    return film(ob, frames) - rest


BONE = "f_index.01_master.L"
NO_NUMBERS = (
    f'pose.bones["{BONE}"].matrix.y',
    f'pose.bones["{BONE}"].scale.q',
    f'pose.bones["{BONE}"].scale[7]',
    f'pose.bones["{BONE}"].bone.name',
    'pose.bones["gone"].scale.y',
    "animation_data.action",
    "nothing.x",
    ".x",
    "",
)


@pytest.fixture
def bone_that_drives():
    """A head and a rig. A driver of the head's shape key reads a bone's scale by axis letter."""
    ob = rigs.head()
    data = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", data)
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = data.edit_bones.new(BONE)
    bone.tail = (0.0, 0.0, 0.1)
    bpy.ops.object.mode_set(mode="OBJECT")
    ob.shape_key_add(name="Basis")
    driver = ob.shape_key_add(name="Wide").driver_add("value").driver
    driver.type = "SUM"
    target = driver.variables.new().targets[0]
    target.id, target.data_path = rig, f'pose.bones["{BONE}"].scale.y'
    return ob, rig


def test_components_that_drivers_read_by_a_letter_are_controls(addon, bone_that_drives):
    ob, rig = bone_that_drives
    sources = addon("scene.rig_controls.control_sources")
    (source,) = [s for s in sources.propose(ob, rig, []) if s.kind == sources.NUMBER]
    (control,) = source.controls(0.1)
    assert (control.curve_path, control.indices) == (f'pose.bones["{BONE}"].scale', [1])
    control.set([0.5])
    assert rig.pose.bones[BONE].scale[1] == pytest.approx(1.5)
    assert control.read() == [pytest.approx(1.5)]


@pytest.mark.parametrize("path", NO_NUMBERS)
def test_paths_that_are_no_number_are_no_controls(addon, bone_that_drives, path):
    _, rig = bone_that_drives
    assert addon("scene.rig_controls.control_kinds").number(rig, path) is None


def test_a_crude_rig_speaks_and_is_left_as_it_was(voice, addon):
    ob = ready(rigs.head(), voice)
    target = truth(ob, voice)
    rigs.crude(addon, ob)
    bpy.context.scene.frame_set(1)
    before = everything()
    shown = speak(ob, voice)
    shares = share(ob, target, shown), closed(ob, target, shown)
    print("crude", shares)
    assert shares[0] > 0.85 and shares[1] >= 0.9
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert everything() == before


def test_a_linked_character_speaks_on_its_controls(voice, addon, tmp_path):
    """*Make Library Override* leaves all objects but the chosen one as system overrides."""
    head, library = rigs.head(), str(tmp_path / "library.blend")
    rigs.crude(addon, head)
    character = bpy.data.collections.new("Character")
    bpy.context.scene.collection.children.link(character)
    for ob in list(bpy.context.scene.collection.objects):
        character.objects.link(ob)
        bpy.context.scene.collection.objects.unlink(ob)
    name = head.name
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(library, link=True) as (_, target):
        target.collections = ["Character"]
    scene, layer = bpy.context.scene, bpy.context.view_layer
    target.collections[0].override_hierarchy_create(scene, layer, do_fully_editable=False)
    ob = next(ob for ob in scene.objects if ob.name == name and ob.library is None)
    assert ob.override_library.is_system_override
    shown = speak(ready(ob, voice), voice)
    assert gaps(ob, shown).max() > 0.004


def test_controls_on_twos_stand_still_until_the_next_pose(voice, addon):
    ob = ready(rigs.head(), voice)
    rig = rigs.crude(addon, ob)
    ob.anyface.curves, ob.anyface.pose_on = "HELD", 2
    shown = speak(ob, voice)
    steps = np.abs(np.diff(shown, axis=0)).max(axis=(1, 2))
    # A new pose begins at every even frame of the take and stays through the next odd frame.
    assert steps[0::2].max() < 1e-6 < 1e-3 < steps[1::2].max()
    assert len(curves(rig.animation_data.action)) > 10


def test_keys_that_are_all_driven_speak_at_what_drives_them(voice, addon):
    ob = ready(rigs.head(), voice)
    target = truth(ob, voice)
    rig = rigs.driven(addon, ob)
    bpy.context.scene.frame_set(1)
    before = everything()
    shown = speak(ob, voice)
    shares = share(ob, target, shown), closed(ob, target, shown)
    print("driven", shares)
    assert shares[0] > 0.85 and shares[1] >= 0.9
    animated = {curve.data_path for curve in curves(rig.animation_data.action)}
    assert '["jawOpen"]' in animated and ob.data.shape_keys.animation_data.action is None
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    bpy.context.scene.frame_set(1)
    assert everything() == before


def test_controllers_that_bones_follow_are_what_is_animated(voice, addon):
    ob = ready(rigs.head(), voice)
    target = truth(ob, voice)
    rig = rigs.controllers(addon, ob)
    bpy.context.scene.frame_set(1)
    before = everything()
    shown = speak(ob, voice)
    shares = share(ob, target, shown), closed(ob, target, shown)
    print("controllers", shares)
    animated = {curve.data_path for curve in curves(rig.animation_data.action)}
    bones = {path.split('"')[1] for path in animated if path.startswith("pose.bones")}
    assert bones and all(name.startswith("c_") for name in bones), bones
    assert shares[0] > 0.85 and shares[1] >= 0.9
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    bpy.context.scene.frame_set(1)
    assert everything() == before


def test_keys_of_vroid_speak_without_a_word(voice, addon):
    ob = ready(rigs.head(), voice)
    target = truth(ob, voice)
    rigs.vroid(addon, ob)
    ob.anyface.property_unset("mode")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    print(ob.anyface.report)
    frames = frames_of(voice)
    shown = film(ob, frames) - film(ob, [frames[0] - 30])[0]
    shares = share(ob, target, shown), closed(ob, target, shown)
    print("vroid", ob.anyface.mode, shares)
    assert ob.anyface.mode == "keys"
    # Five vowel keys can only open the mouth, so the other motion is lost while the lips meet.
    # The more a mouth widens and narrows in speech, the more is lost.
    assert shares[0] > 0.78 and shares[1] >= 0.95


@pytest.fixture
def rigify():
    """Enables Blender's own Rigify."""
    if rigify_face.enable() is None:
        pytest.skip("this Blender has no Rigify")
    yield
    rigify_face.disable()


WHOLE = [False, *([True] if os.environ.get("ANYFACE_WHOLE_RIGS") else [])]


@pytest.mark.parametrize("whole", WHOLE)
def test_the_face_that_rigify_makes_speaks(voice, addon, rigify, whole):
    ob = ready(rigs.head(), voice)
    target = truth(ob, voice)
    rig = rigify_face.bind(addon, ob, whole)
    bpy.context.scene.frame_set(1)
    before = everything()
    shown = speak(ob, voice)
    shares = share(ob, target, shown), closed(ob, target, shown)
    print("rigify", shares, len(rig.pose.bones))
    animated = {curve.data_path for curve in curves(rig.animation_data.action)}
    assert not any("DEF-" in path or "spine" in path for path in animated)
    assert shares[0] > 0.85 and shares[1] >= 0.9
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    bpy.context.scene.frame_set(1)
    assert everything() == before


@pytest.mark.skipif("ANYFACE_MPFB" not in os.environ, reason="needs the wheel of mpfb_face.py")
def test_the_human_of_mpfb_speaks(voice, addon, monkeypatch):
    ob, rig = mpfb_face.human(os.environ["ANYFACE_MPFB"])
    ready(ob, voice)
    bpy.context.view_layer.update()
    target = truth(ob, voice)
    settings = addon("ui.settings").from_object(ob)
    face = addon("scene.bake").read_face(ob, settings, editable=False)
    engine, progress = addon("ui.running").engine(settings.system), addon("core.job").Progress()
    face_points = addon("core.finding").find(face, {}, engine.find, progress)
    monkeypatch.setattr(rigs, "LANDMARKS", [{"vertex": int(v)} for v in face_points.vertices])
    monkeypatch.setattr(rigs, "landmarks", lambda: rigs.positions(ob)[face_points.vertices])
    monkeypatch.setattr(rigs, "skin_vertices", lambda: mpfb_face.BODY)
    bpy.context.scene.frame_set(1)
    before = everything()
    shown = speak(ob, voice)
    shares = share(ob, target, shown), closed(ob, target, shown)
    print("mpfb", shares, len(rig.pose.bones))
    animated = {curve.data_path.split('"')[1] for curve in curves(rig.animation_data.action)}
    assert not animated & {"head", "neck01", "neck02", "neck03", "spine01"}
    assert shares[0] > 0.85 and shares[1] >= 0.9
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert everything() == before
