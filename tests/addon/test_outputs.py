"""The outputs other than basis keys and every frame: caches, existing keys, ARKit keys, tables."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from figures import curves, everything, grid, motion, own_keys, shape, stand_in, tone

START = 5


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def ready(tmp_path, mode, ob=None, save=True):
    """A head with a sound file and the output `mode`, saved next to the sound."""
    bpy.context.scene.render.fps = 24
    ob = ob or grid()
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav")
    ob.anyface.mode = mode
    if save:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
        ob = bpy.data.objects[ob.name]
    return ob


def expected(stage, ob):
    """The displacements that the stage gives."""
    return motion(48, len(ob.data.vertices), stage.rank, stage.size)


def failure():
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.anyface.generate()
    return str(caught.value)


def rest(ob):
    return np.array([vertex.co for vertex in ob.data.vertices], dtype=np.float32)


def files(folder):
    return sorted(path.name for path in Path(folder).rglob("*") if path.is_file())


def test_names_and_numbers_of_outputs_are_those_in_blend_files(addon):
    items = bpy.types.Object.bl_rna.properties["anyface"].fixed_type.properties["mode"].enum_items
    stored = ["basis", "frames", "cache", "keys", "arkit", "csv", "controls"]
    assert [item.identifier for item in items] == stored
    assert [item.value for item in items] == list(range(7))
    assert addon("scene.outputs").WORDS == "basis, frames, cache, keys, arkit, csv or controls"


def test_no_file_but_its_own_names_an_output(installed):
    names = {f'"{name}"' for name in ("basis", "frames", "arkit", "csv")}
    file_names = {path.name for path in (installed / "scene").rglob("*.py") for name in names
             if name in path.read_text()}  # fmt: skip
    assert file_names == {"basis.py", "frames.py", "arkit.py", "csv.py"}


def test_a_cache_plays_every_frame_and_goes_with_remove(stage, tmp_path):
    ob = ready(tmp_path, "cache")
    before, there = everything(), files(tmp_path)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    moved = expected(stage, ob)
    for t in (0, 1, 20, 47):
        assert np.abs(shape(ob, START + t) - rest(ob) - moved[t]).max() < 1e-6
    assert np.abs(shape(ob, START - 10) - rest(ob)).max() < 1e-7
    assert np.abs(shape(ob, START + 60) - rest(ob)).max() < 1e-7
    assert ob.data.shape_keys is None
    assert ob.modifiers[0].filepath.startswith("//anyface_cache")
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert bpy.ops.anyface.remove_unused_caches() == {"FINISHED"}
    assert (everything(), files(tmp_path)) == (before, there)
    assert not (tmp_path / "anyface_cache").exists() and len(ob.modifiers) == 0


def test_undo_brings_a_removed_cache_back_with_its_file(stage, tmp_path):
    ob = ready(tmp_path, "cache")
    bpy.ops.anyface.generate()
    bpy.ops.ed.undo_push(message="Generate")
    moved = shape(ob, START + 20)
    bpy.ops.anyface.remove()
    bpy.ops.ed.undo_push(message="Remove")
    bpy.ops.ed.undo()
    assert np.array_equal(shape(bpy.data.objects["Head"], START + 20), moved)


def test_a_cache_goes_before_other_modifiers_and_adds_to_keys(stage, tmp_path):
    ob = ready(tmp_path, "cache")
    own_keys(ob, "Smile")
    ob.modifiers.new("Subdivision", "SUBSURF")
    posed = rest(ob) + 0.25 * (np.arange(len(ob.data.vertices)) == 0)[:, None] * (0.01, 0, 0)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [modifier.type for modifier in ob.modifiers] == ["MESH_CACHE", "SUBSURF"]
    ob.modifiers["Subdivision"].show_viewport = False
    assert np.abs(shape(ob, START + 20) - posed - expected(stage, ob)[20]).max() < 2e-4
    bpy.ops.anyface.remove()
    assert [modifier.name for modifier in ob.modifiers] == ["Subdivision"]
    assert ob.data.shape_keys.key_blocks["Smile"].value == pytest.approx(0.25)


def test_a_cache_works_on_a_linked_character_and_survives_saving(stage, tmp_path):
    grid()
    library, shot = str(tmp_path / "library.blend"), str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=shot)
    with bpy.data.libraries.load(library, link=True) as (_, target):
        target.objects = ["Head"]
    linked = bpy.data.objects["Head"]
    ob = linked.override_create(remap_local_usages=True)
    bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.objects.active = ob
    assert ob.data.library is not None
    ob = ready(tmp_path, "basis", ob, save=False)
    assert "linked from" in failure()
    ob.anyface.mode = "cache"
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    moved = rest(ob) + expected(stage, ob)[20]
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=shot)
    ob = next(ob for ob in bpy.data.objects if ob.override_library is not None)
    assert np.abs(shape(ob, START + 20) - moved).max() < 1e-6
    bpy.context.view_layer.objects.active = ob
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert len(ob.modifiers) == 0
    bpy.ops.wm.save_mainfile()
    Path(f"{shot}1").unlink()
    bpy.ops.anyface.remove_unused_caches()
    assert not list(tmp_path.rglob("*.pc2"))


def test_a_rigged_override_is_refused_a_cache_until_its_object_is_local(stage, tmp_path):
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    grid().modifiers.new("Armature", "ARMATURE").object = rig
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, target):
        target.objects = ["Head"]
    ob = bpy.data.objects["Head"].override_create(remap_local_usages=True)
    bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.objects.active = ob
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    ready(tmp_path, "cache", ob, save=False)
    assert "Armature of the library acts before" in failure()
    ob.select_set(True)
    bpy.ops.object.make_local(type="SELECT_OBJECT")
    assert ob.data.library is not None
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [modifier.type for modifier in ob.modifiers] == ["MESH_CACHE", "ARMATURE"]


def test_a_cancelled_cache_leaves_no_file(addon, tmp_path):
    job, pc2 = addon("core.job"), addon("core.pc2")
    progress = job.Progress()
    progress.cancel()
    path = tmp_path / "folder" / "a.pc2"
    with pytest.raises(addon("core.errors").Cancelled):
        pc2.write(path, np.zeros((4, 3)), np.zeros((2, 4, 3)), 1, progress)
    assert files(tmp_path) == []


def test_an_unsaved_file_and_a_linked_object_are_told_what_helps(stage, tmp_path, addon):
    ob = ready(tmp_path, "cache", save=False)
    assert "save it first" in failure()
    ob.anyface_output.cache_folder = str(tmp_path / "elsewhere")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert len(list((tmp_path / "elsewhere").iterdir())) == 1


def arkit_keys(stage, ob):
    """Adds the stage's shapes as keys of an artist who spells them in his own way."""
    rig = stage.rig(rest(ob), None, None, None, None, stage_progress())
    ob.shape_key_add(name="Basis", from_mix=False)
    for name, vector in list(zip(rig.names, rig.vectors, strict=True))[: 2 * stage.rank]:
        spelled = "Face." + name.replace("Left", "_L").replace("Right", "_R").lower()
        block = ob.shape_key_add(name=spelled, from_mix=False)
        block.points.foreach_set("co", (rest(ob) + vector).ravel())
    ob.shape_key_add(name="Mole", from_mix=False)
    return ob.data.shape_keys


def stage_progress():
    class Silent:
        def check(self, *_):
            """Never cancels."""

    return Silent()


def artist_values(shape_keys):
    shape_keys.key_blocks[2].value = 0.4


def artist_curves(shape_keys):
    for frame, value in ((1, 0.1), (30, 0.7)):
        for number in (1, -1):
            block = shape_keys.key_blocks[number]
            block.value = value
            block.keyframe_insert("value", frame=frame)


def artist_drivers(shape_keys):
    shape_keys.key_blocks[1].driver_add("value").driver.expression = "0.5"
    shape_keys.key_blocks[3].mute = True


@pytest.mark.parametrize("artist", [artist_values, artist_curves, artist_drivers])
def test_existing_keys_speak_and_are_given_back(stage, tmp_path, artist):
    ob = ready(tmp_path, "keys")
    artist(arkit_keys(stage, ob))
    bpy.context.scene.frame_set(3)
    before = everything()
    for _ in range(2):
        assert bpy.ops.anyface.generate() == {"FINISHED"}
    names = [block.name for block in ob.data.shape_keys.key_blocks]
    assert len(names) == 2 * stage.rank + 2 and "driven" in ob.anyface.report
    if artist is not artist_drivers:
        error = shape(ob, START + 20) - rest(ob) - expected(stage, ob)[20]
        assert np.abs(error).max() < 0.05 * stage.size
    else:
        animated = {c.data_path for c in curves(ob.data.shape_keys.animation_data.action)}
        assert not any(names[n] in path for n in (1, 3) for path in animated)
        assert f"left alone: {names[1]}, {names[3]})" in ob.anyface.report
    bpy.context.scene.frame_set(3)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    bpy.context.scene.frame_set(3)
    assert everything() == before


def test_work_in_the_standing_in_action_is_kept(stage, tmp_path):
    ob = ready(tmp_path, "keys")
    artist_curves(arkit_keys(stage, ob))
    first = ob.data.shape_keys.key_blocks[1].name
    bpy.ops.anyface.generate()
    mole = ob.data.shape_keys.key_blocks["Mole"]
    mole.value = 0.9
    mole.keyframe_insert("value", frame=20)
    bpy.ops.anyface.remove()
    fcurves = {c.data_path: c for c in curves(ob.data.shape_keys.animation_data.action)}
    assert len(fcurves['key_blocks["Mole"].value'].keyframe_points) == 3
    first_curve = fcurves[f'key_blocks["{first}"].value']
    assert first_curve.evaluate(30) == pytest.approx(0.7) and len(fcurves) == 2


def test_names_are_matched_however_they_are_written(addon):
    match = addon("core.shapes").match
    keys = ["Basis", "EYEBLINK_LEFT", "cc.mouthSmile_R", "Jaw Open", "head_geo.browInnerUp"]
    assert match(keys) == {
        "eyeBlinkLeft": "EYEBLINK_LEFT",
        "jawOpen": "Jaw Open",
        "mouthSmileRight": "cc.mouthSmile_R",
        "browInnerUp": "head_geo.browInnerUp",
    }
    assert match(["V_aa", "vrc.v_oh", "viseme_PP", "Viseme.CH"]) == {
        "viseme_PP": "viseme_PP",
        "viseme_CH": "Viseme.CH",
        "viseme_aa": "V_aa",
        "viseme_O": "vrc.v_oh",
    }
    assert match(["jaw", "Smile", "mouthful", "aa"]) == {}


def test_the_list_of_keys_is_found_edited_saved_and_loaded(stage, tmp_path):
    ob = ready(tmp_path, "keys")
    arkit_keys(stage, ob)
    assert bpy.ops.anyface.mapping_find() == {"FINISHED"}
    rows = ob.anyface_output.mapping
    assert len(rows) == 2 * stage.rank
    first = rows[0].shape
    rows[0].key = "Mole"
    path = str(tmp_path / "keys.json")
    assert bpy.ops.anyface.mapping_save(filepath=path) == {"FINISHED"}
    assert json.loads(Path(path).read_text())["keys"][0] == [first, "Mole", 1.0]
    assert bpy.ops.anyface.mapping_clear() == {"FINISHED"} and not len(rows)
    assert bpy.ops.anyface.mapping_load(filepath=path) == {"FINISHED"}
    assert rows[0].key == "Mole" and len(rows) == 2 * stage.rank
    bpy.ops.anyface.generate()
    animated = {c.data_path for c in curves(ob.data.shape_keys.animation_data.action)}
    assert 'key_blocks["Mole"].value' in animated
    Path(path).write_text('{"keys": {"nose": "Mole"}}')
    with pytest.raises(RuntimeError, match="nose"):
        bpy.ops.anyface.mapping_load(filepath=path)


def test_a_mesh_without_such_keys_is_told_what_helps(stage, tmp_path):
    ob = ready(tmp_path, "keys")
    own_keys(ob, "Smile")
    before = everything()
    assert "Make ARKit Keys" in failure()
    assert everything() == before


def test_arkit_keys_are_made_beside_own_keys_and_removed(stage, tmp_path):
    ob = ready(tmp_path, "arkit")
    own_keys(ob, "Smile", "viseme_aa")
    bpy.context.scene.frame_set(1)
    before = everything()
    base = shape(ob, 1)
    bpy.ops.anyface.generate()
    names = [block.name for block in ob.data.shape_keys.key_blocks]
    assert names[:3] == ["Basis", "Smile", "viseme_aa"] and len(names) == 3 + 52
    error = shape(ob, START + 20) - base - expected(stage, ob)[20]
    assert np.abs(error).max() < 0.05 * stage.size
    ob.anyface_output.visemes = True
    assert "viseme_aa" in failure()
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    assert everything() == before
    ob.shape_key_remove(ob.data.shape_keys.key_blocks["viseme_aa"])
    bpy.ops.anyface.generate()
    assert len(ob.data.shape_keys.key_blocks) == 2 + 52 + 15


def test_a_table_changes_no_mesh_and_overwrites_no_file(stage, tmp_path):
    ob = ready(tmp_path, "csv")
    ob.anyface.mode = "basis"
    bpy.ops.anyface.generate()
    bpy.context.scene.frame_set(1)
    before = [row for row in everything() if not row.startswith("objects Head")]
    ob.anyface.mode = "csv"
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [row for row in everything() if not row.startswith("objects Head")] == before
    table = (tmp_path / "shot_Head.csv").read_text().splitlines()
    assert len(table) == 1 + 48
    (tmp_path / "shot_Head.csv").write_text("mine")
    assert "exists already" in failure()
    bpy.ops.anyface.remove()
    assert (tmp_path / "shot_Head.csv").read_text() == "mine"
    bpy.ops.anyface.generate.poll()
    ob.anyface_output.csv_file = str(tmp_path / "new" / "a.csv")
    bpy.ops.anyface.generate()
    bpy.ops.anyface.remove()
    assert not (tmp_path / "new" / "a.csv").exists()


@pytest.mark.parametrize("first", ["basis", "cache", "arkit", "keys"])
def test_outputs_replace_each_other(stage, tmp_path, first):
    ob = ready(tmp_path, first)
    arkit_keys(stage, ob)
    for block in ob.data.shape_keys.key_blocks[1:]:
        block.name = block.name if first == "keys" else block.name.replace("Face.", "Own")
    bpy.context.scene.frame_set(1)
    before, there = everything(), files(tmp_path)
    bpy.ops.anyface.generate()
    ob.anyface.mode = "cache" if first != "cache" else "basis"
    bpy.ops.anyface.generate()
    error = shape(ob, START + 20) - rest(ob) - expected(stage, ob)[20]
    assert np.abs(error).max() < 2e-4
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    bpy.ops.anyface.remove_unused_caches()
    assert (everything(), files(tmp_path)) == (before, there)


@pytest.mark.parametrize("mode", ["cache", "arkit", "basis"])
def test_objects_beside_the_face_follow_in_every_output(stage, tmp_path, mode):
    ob = grid()
    teeth = grid("Teeth_low", side=5, scale=0.1)
    teeth.location, teeth.rotation_euler.z, teeth.scale = (0.0, 0.02, -0.03), 0.5, (2.0, 2.0, 2.0)
    bpy.context.view_layer.objects.active = ob
    bpy.context.view_layer.update()
    ob = ready(tmp_path, mode, ob)
    teeth = bpy.data.objects["Teeth_low"]
    bpy.ops.anyface.find_parts()
    before, there = everything(), files(tmp_path)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    moved = motion(48, 169, stage.rank, stage.size)[20]
    for part, expected in ((ob, moved[:144]), (teeth, moved[144:])):
        shift = shape(part, START + 20) - rest(part)
        turned = shift @ np.array(part.matrix_world)[:3, :3].T
        assert np.abs(turned - expected).max() < 0.05 * stage.size
    if mode != "cache":
        bpy.ops.anyface.take_keep()
        assert np.abs(shape(teeth, START + 20) - rest(teeth)).max() < 1e-6
        bpy.ops.anyface.take_switch(take=ob_takes(ob)[0])
        turned = (shape(teeth, START + 20) - rest(teeth)) @ np.array(teeth.matrix_world)[:3, :3].T
        assert np.abs(turned - moved[144:]).max() < 0.05 * stage.size
        bpy.ops.anyface.take_push_down(take=ob_takes(ob)[0])
        turned = (shape(teeth, START + 20) - rest(teeth)) @ np.array(teeth.matrix_world)[:3, :3].T
        assert np.abs(turned - moved[144:]).max() < 0.05 * stage.size
        bpy.ops.anyface.take_switch(take=ob_takes(ob)[0])
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    bpy.ops.anyface.remove_unused_caches()
    assert (everything(), files(tmp_path)) == (before, there)


def ob_takes(ob):
    """Ids of all takes of `ob`."""
    texts = [ob.data.shape_keys.get(name) for name in ("anyface", "anyface_takes")]
    records = [json.loads(text) for text in texts if text]
    return [row["id"] for rows in records for row in (rows if isinstance(rows, list) else [rows])]


@pytest.mark.parametrize("mode", ["basis", "arkit"])
def test_strength_and_shift_change_the_take_that_is_there(stage, tmp_path, mode):
    ob = ready(tmp_path, mode)
    bpy.ops.anyface.generate()
    full = shape(ob, START + 20) - rest(ob)
    settings = ob.anyface_output
    for strength, shift in ((0.5, 0.0), (0.25, 3.0), (1.5, -2.5), (1.0, 0.0)):
        settings.strength, settings.shift = strength, shift
        moved = shape(ob, START + 20 + shift) - rest(ob)
        assert np.abs(moved - strength * full).max() < 1e-5
        assert (settings.strength, settings.shift) == pytest.approx((strength, shift))
    if mode == "arkit":
        settings.blinks = 0.5
        animation = ob.data.shape_keys.animation_data
        fcurves = {curve.data_path: curve for curve in curves(animation.action)}
        blink = fcurves['key_blocks["eyeBlinkLeft"].value'].evaluate(START + 20)
        settings.blinks = 1.0
        assert fcurves['key_blocks["eyeBlinkLeft"].value'].evaluate(START + 20) == pytest.approx(
            2.0 * blink, abs=1e-6
        )
        assert blink > 0.0
        assert np.abs(shape(ob, START + 20) - rest(ob) - full).max() < 1e-5
    settings.strength = 2.0
    bpy.ops.anyface.generate()
    assert settings.strength == 1.0
    assert np.abs(shape(ob, START + 20) - rest(ob) - full).max() < 1e-6


def test_objects_beside_the_face_follow_with_their_own_keys(stage, tmp_path):
    ob = grid()
    teeth = grid("Teeth_low", side=5, scale=0.1)
    bpy.context.view_layer.objects.active = ob
    bpy.context.view_layer.update()
    ob = ready(tmp_path, "keys", ob)
    teeth = bpy.data.objects["Teeth_low"]
    arkit_keys(stage, ob)
    teeth.shape_key_add(name="Basis", from_mix=False)
    block = teeth.shape_key_add(name="teeth.eyeBlinkLeft", from_mix=False)
    block.points[0].co.x += 0.01
    bpy.ops.anyface.find_parts()
    bpy.context.scene.frame_set(1)
    before = everything()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    values = []
    for frame in (START + 10, START + 20):
        bpy.context.scene.frame_set(frame)
        values.append((ob.data.shape_keys.key_blocks[1].value, block.value))
    assert values[0] != values[1] and all(
        face_value == pytest.approx(other) for face_value, other in values
    )
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert everything() == before
