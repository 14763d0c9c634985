"""Work that must not be lost: file versions, duplicates, instances, several takes."""

from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from figures import belongings, duplicate, grid, own_keys, select, shape, stand_in, tone

START = 5
KEYED = ("basis", "frames", "arkit")
ON_MESH = (*KEYED, "cache")


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def character(tmp_path, mode="basis", saved="shot_v001"):
    """A head with teeth that is ready to speak, in a saved file."""
    bpy.context.scene.render.fps = 24
    teeth = grid("Teeth_low", 5, 0.05)
    ob = grid("Head")
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file, ob.anyface.mode = tone(tmp_path / "tone.wav"), mode
    part = ob.anyface_face.parts.add()
    part.object, part.name, part.role = teeth, teeth.name, "jaw"
    save(tmp_path, saved)
    return ob, teeth


def save(tmp_path, name):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / f"{name}.blend"))


def generate(ob):
    select(ob)
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def remove(ob):
    select(ob)
    assert bpy.ops.anyface.remove() == {"FINISHED"}


def moves(ob):
    """The largest change of a coordinate from before the take to one frame of it."""
    return float(np.abs(shape(ob, START + 20) - shape(ob, START - 30)).max())


def both(*objects):
    bpy.context.scene.frame_set(1)
    return [belongings(ob) for ob in objects]


def test_every_version_of_a_file_keeps_its_cache(stage, tmp_path):
    ob, _ = character(tmp_path, "cache")
    generate(ob)
    bpy.ops.wm.save_mainfile()
    first = shape(ob, START + 20)
    save(tmp_path, "shot_v002")
    stage.size = 0.009
    generate(ob)
    bpy.ops.wm.save_mainfile()
    second = shape(ob, START + 20)
    for name, expected in (("shot_v001", first), ("shot_v002", second)):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / f"{name}.blend"))
        assert np.abs(shape(bpy.data.objects["Head"], START + 20) - expected).max() < 1e-6
    names = {path.name.split("_Head_")[0] for path in tmp_path.rglob("*_Head_*.pc2")}
    assert names == {"shot_v001", "shot_v002"}


def test_baking_into_another_file_leaves_the_first_one_its_cache(addon, stage, tmp_path):
    ob, _ = character(tmp_path, "cache")
    generate(ob)
    bpy.ops.wm.save_mainfile()
    before = shape(ob, START + 20)
    other = tmp_path / "other.blend"
    words = ["bake", "--object", "Head", "--mode", "cache", "--save", str(other)]
    assert addon("command").main(words) == 0
    for path in (tmp_path / "shot_v001.blend", other):
        bpy.ops.wm.open_mainfile(filepath=str(path))
        assert np.abs(shape(bpy.data.objects["Head"], START + 20) - before).max() < 1e-6


def test_only_the_button_deletes_caches_and_none_that_a_file_may_play(stage, tmp_path):
    ob, _ = character(tmp_path, "cache")
    for name in ("shot_v001", "shot_v002", "shot_v003"):
        generate(ob)
        save(tmp_path, name)
    generate(ob)
    remove(ob)
    generate(ob)
    folder = tmp_path / "anyface_cache"
    assert len(list(folder.iterdir())) == 2 * 5
    (folder / "holiday.pc2").write_bytes(b"an artist's own")
    played = both(ob)
    assert bpy.ops.anyface.remove_unused_caches() == {"FINISHED"}
    # The caches that v001, v002 and v003 play remain, and the unsaved one that this scene plays.
    assert len(list(folder.iterdir())) == 2 * 4 + 1
    assert (folder / "holiday.pc2").is_file() and both(ob) == played
    for name in ("shot_v001", "shot_v002", "shot_v003"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / f"{name}.blend"))
        assert moves(bpy.data.objects["Head"]) > 0.001


def test_a_compressed_file_beside_it_still_holds_its_caches(stage, tmp_path):
    ob, _ = character(tmp_path, "cache")
    generate(ob)
    path = str(tmp_path / "packed.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, compress=True, copy=True)
    remove(ob)
    bpy.ops.anyface.remove_unused_caches()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert moves(bpy.data.objects["Head"]) > 0.001


def acting(kind, ob):
    return generate(ob) if kind == "generate" else remove(ob)


def copy_both(ob, teeth):
    return duplicate(ob, teeth)


def copy_by_script(ob, teeth):
    copies = []
    for one in (ob, teeth):
        other = one.copy()
        other.data = one.data.copy()
        bpy.context.scene.collection.objects.link(other)
        copies.append(other)
    return copies


def copy_scene(ob, teeth):
    bpy.ops.scene.new(type="FULL_COPY")
    objects = list(bpy.context.scene.objects)
    return [next(o for o in objects if o.name.startswith(n)) for n in ("Head", "Teeth")]


@pytest.mark.parametrize("mode", ON_MESH)
@pytest.mark.parametrize("kind", ["generate", "remove"])
@pytest.mark.parametrize("copy", [copy_both, copy_by_script, copy_scene])
def test_a_copied_character_is_another_one(stage, tmp_path, copy, kind, mode):
    ob, teeth = character(tmp_path, mode)
    generate(ob)
    first = bpy.context.window.scene
    before = both(ob, teeth)
    other, others = copy(ob, teeth)
    stage.size = 0.009
    acting(kind, other)
    assert both(ob, teeth) == before
    assert (moves(others) > 0.0) == (kind == "generate")
    assert [part.object for part in other.anyface_face.parts] == [others]
    then = both(other, others)
    bpy.context.window.scene = first
    acting(kind, ob)
    assert both(other, others) == then
    assert (moves(teeth) > 0.0) == (kind == "generate")


@pytest.mark.parametrize("mode", ON_MESH)
@pytest.mark.parametrize("kind", ["generate", "remove"])
def test_a_head_copied_alone_leaves_the_teeth_to_the_first(stage, tmp_path, kind, mode):
    ob, teeth = character(tmp_path, mode)
    generate(ob)
    before = both(ob, teeth)
    (other,) = duplicate(ob)
    stage.size = 0.009
    acting(kind, other)
    assert both(ob, teeth) == before
    assert not len(other.anyface_face.parts)
    then = both(other)
    acting(kind, ob)
    assert both(other) == then and (moves(teeth) > 0.0) == (kind == "generate")


@pytest.mark.parametrize("kind", ["generate", "remove"])
def test_copies_are_told_apart_after_saving_and_renaming(stage, tmp_path, kind):
    ob, teeth = character(tmp_path)
    generate(ob)
    duplicate(ob, teeth)
    ob.name, teeth.name = "Zora", "Zähne"
    save(tmp_path, "shot_v002")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot_v002.blend"))
    ob, teeth, other = (bpy.data.objects[n] for n in ("Zora", "Zähne", "Head.001"))
    before = both(ob, teeth)
    acting(kind, other)
    assert both(ob, teeth) == before
    then = both(other)
    acting(kind, ob)
    assert both(other) == then and (moves(teeth) > 0.0) == (kind == "generate")


def test_teeth_that_speak_with_a_face_are_left_out_of_another_one(stage, tmp_path):
    ob, teeth = character(tmp_path)
    other = grid("Bert")
    other.anyface.source, other.anyface.sound_file = "FILE", ob.anyface.sound_file
    part = other.anyface_face.parts.add()
    part.object, part.name = teeth, teeth.name
    generate(ob)
    before = both(ob, teeth)
    generate(other)
    assert both(ob, teeth) == before and "Teeth_low belongs to Head" in other.anyface.report


def shapes_of_an_artist(stage, ob):
    """Adds the stage's shapes as the artist's own keys."""
    silent = SimpleNamespace(check=lambda *_: None)
    rest = np.array([vertex.co for vertex in ob.data.vertices], dtype=np.float32)
    rig = stage.rig(rest, None, None, None, None, silent)
    blocks = own_keys(ob, *rig.names[: 2 * stage.rank]).key_blocks
    for block, vector in zip(blocks[1:], rig.vectors, strict=False):
        block.points.foreach_set("co", (rest + vector).ravel())
        block.value = 0.0


@pytest.mark.parametrize("mode", ["basis", "arkit", "cache", "keys", "frames"])
@pytest.mark.parametrize("before_take", [True, False])
@pytest.mark.parametrize("kind", ["generate", "remove"])
def test_instances_speak_each_for_itself(stage, tmp_path, mode, before_take, kind):
    ob, _ = character(tmp_path, mode)
    ob.anyface_face.parts.clear()
    if mode == "keys":
        shapes_of_an_artist(stage, ob)
    if before_take:
        (other,) = duplicate(ob, linked=True)
        generate(ob)
        generate(other)
    else:
        generate(ob)
        (other,) = duplicate(ob, linked=True)
    before = both(ob)
    stage.size = 0.009
    acting(kind, other)
    assert both(ob) == before
    then = both(other)
    acting(kind, ob)
    assert both(other) == then
    if kind == "generate":
        remove(ob)
        assert both(other) == then
        remove(other)
    if before_take:
        assert ob.data == other.data


def test_copies_that_share_their_actions_keep_them(stage, tmp_path):
    preferences = bpy.context.preferences.edit
    preferences.use_duplicate_action = False
    try:
        ob, teeth = character(tmp_path)
        generate(ob)
        other, others = duplicate(ob, teeth)
    finally:
        preferences.use_duplicate_action = True
    before, then = both(ob, teeth), both(other, others)
    assert bpy.ops.anyface.take_keep() == {"FINISHED"}
    assert both(ob, teeth) == before
    remove(ob)
    select(other)
    row = bpy.ops.anyface.take_switch
    assert row(take=takes_of(other)[0].id) == {"FINISHED"}
    assert both(other, others) == then


def takes_of(ob):
    import importlib

    from conftest import PACKAGE

    return importlib.import_module(f"{PACKAGE}.scene.takes.take_list").rows(ob)


def test_waiting_takes_of_a_copy_are_its_own(stage, tmp_path):
    ob, teeth = character(tmp_path)
    ob.anyface_output.new_take = True
    for size in (0.004, 0.008):
        stage.size = size
        generate(ob)
    before = both(ob, teeth)
    other, others = duplicate(ob, teeth)
    for row in takes_of(other):
        select(other)
        bpy.ops.anyface.take_switch(take=row.id)
        other.anyface_output.strength = 0.5
        assert both(ob, teeth) == before
    for row in takes_of(other):
        bpy.ops.anyface.take_push_down(take=row.id)
    for row in takes_of(other):
        bpy.ops.anyface.take_delete(take=row.id)
    assert both(ob, teeth) == before and others.data.shape_keys is None


def test_the_table_of_the_original_is_not_the_copys(stage, tmp_path):
    ob, _ = character(tmp_path, "csv")
    generate(ob)
    before = both(ob)
    (other,) = duplicate(ob)
    select(other)
    assert not bpy.ops.anyface.remove.poll()
    generate(other)
    assert both(ob) == before
    remove(other)
    assert both(ob) == before and (tmp_path / "shot_v001_Head.csv").is_file()


@pytest.mark.parametrize("named", [False, True])
def test_the_table_of_a_version_is_not_the_next_ones(stage, tmp_path, named):
    ob, _ = character(tmp_path, "csv")
    if named:
        ob.anyface_output.csv_file = str(tmp_path / "face.csv")
    generate(ob)
    bpy.ops.wm.save_mainfile()
    (table,) = tmp_path.glob("*.csv")
    before = table.read_bytes()
    save(tmp_path, "shot_v002")
    stage.size *= 2.0
    if named:
        with pytest.raises(RuntimeError, match="exists already"):
            generate(ob)
    else:
        generate(ob)
        assert (tmp_path / "shot_v002_Head.csv").read_bytes() != before
    remove(ob)
    assert table.read_bytes() == before


def test_takes_of_arkit_keys_are_actions_on_the_same_keys(stage, tmp_path):
    ob, teeth = character(tmp_path, "arkit")
    before = both(ob, teeth)
    ob.anyface_output.new_take = True
    faces = []
    for size in (0.004, 0.008):
        stage.size = size
        generate(ob)
        faces.append((shape(ob, START + 20), shape(teeth, START + 20)))
    for one in (ob, teeth):
        assert len(one.data.shape_keys.key_blocks) == 53
        assert not [b.name for b in one.data.shape_keys.key_blocks if b.name.endswith(".001")]
    rows = takes_of(ob)
    for row, face in zip(rows, faces, strict=True):
        bpy.ops.anyface.take_switch(take=row.id)
        for one, expected in zip((ob, teeth), face, strict=True):
            assert np.abs(shape(one, START + 20) - expected).max() < 1e-6
        ob.anyface_output.mouth = 0.5
        assert ob.anyface_output.mouth == 0.5
    for row in rows:
        bpy.ops.anyface.take_push_down(take=row.id)
    bpy.ops.anyface.take_delete(take=rows[0].id)
    assert len(ob.data.shape_keys.key_blocks) == 53 and moves(ob) > 0.0
    bpy.ops.anyface.take_delete(take=rows[1].id)
    assert both(ob, teeth) == before


def test_keys_that_an_artist_has_sculpted_are_not_made_anew(stage, tmp_path):
    ob, _ = character(tmp_path, "arkit")
    ob.anyface_output.new_take = True
    generate(ob)
    point = ob.data.shape_keys.key_blocks["jawOpen"].points[3]
    point.co.x += 0.01
    place = point.co.copy()
    generate(ob)
    assert ob.data.shape_keys.key_blocks["jawOpen"].points[3].co == place


def test_switching_brings_back_what_was_asked_and_what_was_said(stage, tmp_path):
    ob, _ = character(tmp_path)
    ob.anyface_output.new_take = True
    ob.anyface.emotion, ob.anyface.articulation = "happy", 1.2
    generate(ob)
    first = ob.anyface.report
    ob.anyface.emotion, ob.anyface.articulation = "angry", 0.7
    ob.anyface.mode, stage.size = "arkit", 0.009
    generate(ob)
    second = ob.anyface.report
    ob.anyface.articulation = 0.1
    rows = takes_of(ob)
    for _ in range(2):
        bpy.ops.anyface.take_switch(take=rows[0].id)
        settings = ob.anyface
        assert (settings.emotion, settings.mode, settings.report) == ("happy", "basis", first)
        assert settings.articulation == pytest.approx(1.2)
        bpy.ops.anyface.take_switch(take=rows[1].id)
        assert (settings.emotion, settings.mode, settings.report) == ("angry", "arkit", second)
        assert settings.articulation == pytest.approx(0.7)
    assert Path(bpy.data.filepath).is_file()


@pytest.mark.parametrize("with_empty", [True, False])
@pytest.mark.parametrize("kind", ["generate", "remove"])
def test_what_the_head_turns_is_copied_with_it_or_stays(stage, addon, tmp_path, with_empty, kind):
    ob, _ = character(tmp_path)
    ob.anyface_face.parts.clear()
    empty = bpy.data.objects.new("Neck", None)
    bpy.context.scene.collection.objects.link(empty)
    ob.anyface_life_settings.head = "OBJECT"
    ob.anyface_life_settings.head_object = empty
    take = addon("core.take")
    turned = take.Life(np.full((48, 3), 0.1), np.zeros((48, 2, 2)), np.eye(3, 4))
    plain = stage.animate

    def animate(*arguments):
        animation = plain(*arguments)
        animation.life = turned
        return animation

    stage.animate = animate
    generate(ob)
    before = both(ob, empty)
    assert any("delta_rotation_euler" in row for row in before[1])
    copies = duplicate(ob, empty) if with_empty else duplicate(ob)
    if not with_empty:
        copies[0].anyface_life_settings.head = "NONE"
    acting(kind, copies[0])
    assert both(ob, empty) == before
    then = both(*copies)
    acting("remove", ob)
    assert both(*copies) == then
    assert not any("delta_rotation_euler" in row for row in both(empty)[0])
