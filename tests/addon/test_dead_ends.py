"""Situations where artists used to get stuck: overrides, dialogue, names that change meanwhile."""

import bpy
import numpy as np
import pytest

from figures import curves, grid, select, shape, stand_in, strip, tone

START = 5


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def speaking(tmp_path, ob=None):
    bpy.context.scene.render.fps = 24
    ob = ob or grid()
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav")
    return ob


def test_settings_of_an_override_are_kept(stage, tmp_path):
    teeth = grid("Teeth_low", 5, 0.05)
    teeth.parent = grid()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, target):
        target.objects = ["Head", "Teeth_low"]
    overrides = []
    for linked in target.objects:
        other = linked.override_create(remap_local_usages=True)
        bpy.context.scene.collection.objects.link(other)
        overrides.append(other)
    ob, teeth = speaking(tmp_path, overrides[0]), overrides[1]
    select(ob)
    ob.anyface.mode, ob.anyface.emotion, ob.anyface.articulation = "cache", "happy", 1.3
    ob.anyface_audio.channel = 3
    ob.anyface_life_settings.head = "OWN"
    ob.anyface_output.cache_folder = str(tmp_path / "elsewhere")
    part = ob.anyface_face.parts.add()
    part.object, part.role = teeth, "jaw"
    for group in ("anyface", "anyface_audio", "anyface_life_settings", "anyface_output"):
        assert ob.is_property_overridable_library(group)
        for prop in getattr(ob, group).bl_rna.properties:
            if not prop.is_readonly and prop.identifier not in ("rna_type", "name"):
                assert prop.is_overridable or prop.identifier in SLIDERS, (group, prop.identifier)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    moved = shape(teeth, START + 20)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    overrides_here = [ob for ob in bpy.data.objects if ob.override_library is not None]
    ob, teeth = (next(o for o in overrides_here if o.name.startswith(n)) for n in ("Head", "Teeth"))
    settings = ob.anyface
    assert (settings.mode, settings.emotion) == ("cache", "happy")
    assert settings.articulation == pytest.approx(1.3) and ob.anyface_audio.channel == 3
    assert [part.object for part in ob.anyface_face.parts] == [teeth]
    assert np.abs(shape(teeth, START + 20) - moved).max() < 1e-6
    select(ob)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert not len(ob.modifiers) and not len(teeth.modifiers)


# These properties read and change the take. They store no value of their own.
SLIDERS = {
    "strength", "shift", "articulation", "emotion", "closing", "mouth", "blinks", "brows", "mixed",
}  # fmt: skip


def dialogue(tmp_path):
    """Two speakers who take turns: three strips for Anna, one for Bob."""
    anna, bob = grid("Anna"), grid("Bob", 9)
    try:
        for number, (name, channel) in enumerate(
            (("Anna_01", 1), ("bob.answer", 2), ("Anna_02", 1), ("02 ANNA", 1))
        ):
            path = tone(tmp_path / f"{number}.wav", seconds=0.5)
            strip(path, name=name, frame=1 + 20 * number, channel=channel)
    except RuntimeError as error:
        pytest.skip(str(error).strip())
    return anna, bob


def test_a_dialogue_gives_each_speaker_all_that_he_says(stage, tmp_path):
    anna, bob = dialogue(tmp_path)
    bpy.ops.anyface.scene_fill()
    rows = bpy.context.scene.anyface_list
    assert [(row.strip, row.character) for row in rows] == [
        ("Anna_01", anna), ("bob.answer", bob), ("Anna_02", anna), ("02 ANNA", anna)
    ]  # fmt: skip
    assert bpy.ops.anyface.generate_scene() == {"FINISHED"}
    assert len(stage.calls) == 2
    assert not anna.anyface.report_is_error and not bob.anyface.report_is_error
    assert stage.calls[0][4].duration_s == pytest.approx((60 + 12) / 24, abs=0.05)
    assert stage.calls[1][4].duration_s == pytest.approx(0.5, abs=0.05)
    curve = curves(bob.data.shape_keys.animation_data.action)[0]
    assert curve.keyframe_points[1].co[0] == 21.0


def test_a_row_that_is_not_used_is_no_part_of_the_dialogue(stage, tmp_path):
    dialogue(tmp_path)
    bpy.ops.anyface.scene_fill()
    bpy.context.scene.anyface_list[3].use = False
    bpy.ops.anyface.generate_scene()
    assert stage.calls[0][4].duration_s == pytest.approx((40 + 12) / 24, abs=0.05)


def test_a_face_that_is_renamed_meanwhile_gets_its_take(stage, addon, tmp_path):
    bake, settings_of = addon("scene.bake"), addon("ui.settings").from_object
    teeth, other = grid("Teeth_low", 5, 0.05), grid("Stranger", 5)
    ob = speaking(tmp_path)
    part = ob.anyface_face.parts.add()
    part.object, part.name = teeth, teeth.name
    snapshot = bake.read(ob, bpy.context.scene, settings_of(ob), stage)
    take = snapshot.work(addon("core.job").Progress())
    ob.name, teeth.name, other.name = "Kopf", "Zähne", "Teeth_low"
    bake.write(ob, snapshot, take)
    assert ob.data.shape_keys and teeth.data.shape_keys and not other.data.shape_keys
    bpy.data.objects.remove(teeth)
    with pytest.raises(addon("core.errors").AnyfaceError, match="Zähne is gone"):
        bake.write(ob, snapshot, take)


def test_keys_lie_on_whole_frames_at_the_ends_too(stage, tmp_path):
    ob = speaking(tmp_path)
    for fps in (24, 25, 30):
        bpy.context.scene.render.fps = fps
        bpy.ops.anyface.generate()
        for curve in curves(ob.data.shape_keys.animation_data.action):
            frames = np.array([point.co[0] for point in curve.keyframe_points])
            assert (frames == np.round(frames)).all()
            # No key lies before the first frame of the scene, so the first gap may be shorter.
            assert frames[1] - frames[0] >= min(0.15 * fps, frames[1] - 1)
            assert frames[-1] - frames[-2] >= 0.15 * fps


def test_a_search_that_failed_is_not_made_again_for_the_same_mesh(stage, addon, tmp_path):
    error = addon("core.errors").AnyfaceError
    ob = speaking(tmp_path)
    tried = []

    def fail(*_):
        tried.append(1)
        raise error("face", "no face was found")

    stage.find = stage.animate = fail
    for press in (bpy.ops.anyface.find_face, bpy.ops.anyface.generate, bpy.ops.anyface.generate):
        with pytest.raises(RuntimeError, match=r"Head: .*no face was found"):
            press()
    assert len(tried) == 1
    ob.name = "Kopf"
    with pytest.raises(RuntimeError, match=r"Kopf: .*no face was found"):
        bpy.ops.anyface.generate()
    assert len(tried) == 1
    ob.data.vertices[3].co.x += 0.01
    for number in (2, 2, 3):
        ob.anyface.axes = "LOCAL" if number == 3 else "AUTO"
        with pytest.raises(RuntimeError, match="no face"):
            bpy.ops.anyface.generate()
        assert len(tried) == number


def test_baking_tells_how_far_it_is_unless_it_is_to_be_quiet(stage, addon, tmp_path, capfd):
    grid()
    words = ["bake", "--object", "Head", "--audio", tone(tmp_path / "a.wav")]
    words += ["--save", str(tmp_path / "o.blend")]
    assert addon("command").main(words) == 0
    output = capfd.readouterr()
    assert "anyface: Head: " in output.err
    assert "anyface: Head: " not in output.out
    assert addon("command").main([*words, "--quiet"]) == 0
    assert capfd.readouterr().err == ""
