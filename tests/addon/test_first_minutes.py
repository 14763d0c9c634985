"""The first minutes of a newcomer: few presses suffice, and every grey button says why."""

import bpy
import pytest

from figures import babble, grid, own_keys, select, stand_in, tone


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def heard(tmp_path, ob):
    bpy.context.scene.render.fps = 24
    ob.anyface.source, ob.anyface.sound_file = "FILE", babble(tmp_path / "voice.wav")
    return ob


def rigged(*meshes):
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    for mesh in meshes:
        mesh.modifiers.new("Armature", "ARMATURE").object = rig
    select(rig)
    return rig


def test_the_active_armature_offers_its_head(stage, addon, tmp_path):
    body, shirt, hair = grid("Body", 30, 1.8), grid("Shirt"), grid("Hair")
    head = heard(tmp_path, grid("Face"))
    head.location.z = shirt.location.z = 1.6
    bpy.context.view_layer.update()
    target = addon("ui.target").target
    rig = rigged(body, shirt, hair, head)
    assert target(bpy.context) == head
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert head.data.shape_keys is not None
    head.name = "Mesh.004"
    shirt.name = hair.name = "Cloth"
    assert target(bpy.context) == head, "it has a take"
    bpy.ops.anyface.remove()
    own_keys(body, "jawOpen", "mouthFunnel", "eyeBlinkLeft")
    select(rig)
    assert target(bpy.context) == body, "it has keys that speak"
    for mesh in (body, shirt, hair, head):
        bpy.data.objects.remove(mesh)
    assert target(bpy.context) is None


def test_teeth_are_found_without_asking_once(stage, tmp_path):
    teeth, lamp = grid("Teeth_lower", 5, 0.02), grid("Lamp", 5, 0.02)
    ob = heard(tmp_path, grid())
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [part.object for part in ob.anyface_face.parts] == [teeth]
    assert teeth.data.shape_keys is not None and lamp.data.shape_keys is None
    assert "together with Teeth_lower" in ob.anyface.report
    bpy.ops.anyface.drop_part()
    bpy.ops.anyface.remove()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert not len(ob.anyface_face.parts), "the artist has taken them out"
    assert teeth.data.shape_keys is None


def test_a_head_with_many_known_keys_starts_with_them(stage, addon, tmp_path):
    names = addon("core.shapes").ARKIT[:20]
    ob, other = heard(tmp_path, grid()), grid("Other")
    own_keys(ob, *names)
    own_keys(other, "jawOpen", "Smile")
    settings = addon("ui.settings").from_object
    assert (settings(ob).mode, settings(other).mode) == ("keys", "basis")
    assert ob.anyface.mode == "keys"
    ob.anyface.mode = "basis"
    assert settings(ob).mode == "basis", "the artist has chosen"


def test_generate_is_grey_without_a_sound_and_says_why(stage, addon, tmp_path, monkeypatch):
    ob, said = grid(), []
    cls = addon("ui.generate").ANYFACE_OT_generate
    context = bpy.context
    monkeypatch.setattr(cls, "poll_message_set", said.append, raising=False)
    assert not cls.poll.__func__(cls, context)
    assert "sound" in said[-1]
    heard(tmp_path, ob)
    assert cls.poll.__func__(cls, context)


def test_playback_keeps_step_with_the_sound_from_the_first_take_on(stage, tmp_path):
    ob = heard(tmp_path, grid())
    scene = bpy.context.scene
    scene.sync_mode = "NONE"
    bpy.ops.anyface.generate()
    assert scene.sync_mode == "AUDIO_SYNC" and "Sync to Audio" in ob.anyface.report
    scene.sync_mode = "NONE"
    bpy.ops.anyface.generate()
    assert scene.sync_mode == "NONE" and "Sync to Audio" not in ob.anyface.report


def test_two_presses_lead_from_a_head_to_motion_and_one_where_there_is_a_strip(stage, tmp_path):
    sound = tone(tmp_path / "tone.wav")
    first, second = grid("First"), grid("Second")
    select(first)
    assert bpy.ops.anyface.choose_sound(filepath=sound) == {"FINISHED"}
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert first.data.shape_keys is not None
    select(second)
    if first.anyface.source == "FILE":
        pytest.skip("this Blender has no sound")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert second.data.shape_keys is not None
