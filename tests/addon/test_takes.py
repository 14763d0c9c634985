"""Several takes on one character: keep, switch, rename, push down, delete."""

import bpy
import numpy as np
import pytest

from figures import curves, everything, grid, own_keys, shape, stand_in, tone

START = 5


@pytest.fixture
def stage(addon):
    """A stage that stands in for the engine."""
    return stand_in(addon)


def ready(tmp_path):
    bpy.context.scene.render.fps = 24
    ob = grid()
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file = tone(tmp_path / "tone.wav")
    return ob


def artist_nothing(ob):
    """A plain mesh."""


def artist_keys(ob):
    own_keys(ob, "Smile")


def artist_curves(ob):
    block = own_keys(ob, "Smile", "jawOpen").key_blocks["Smile"]
    for frame, value in ((1, 0.2), (40, 0.9)):
        block.value = value
        block.keyframe_insert("value", frame=frame)


def two_takes(stage, ob):
    """Generates two takes of different size; returns the face of each at the same frame."""
    ob.anyface_output.new_take = True
    faces = []
    for size in (0.004, 0.008):
        stage.size = size
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        faces.append(shape(ob, START + 20))
    return faces


def rows(addon, ob):
    return {row.name: row for row in addon("scene.takes.take_list").rows(ob)}


ARTISTS = [artist_nothing, artist_keys, artist_curves]


@pytest.mark.parametrize("artist", ARTISTS)
def test_switching_shows_each_take_and_deleting_leaves_the_file_as_it_was(
    addon, stage, tmp_path, artist
):
    ob = ready(tmp_path)
    artist(ob)
    bpy.context.scene.frame_set(1)
    before = everything()
    first, second = two_takes(stage, ob)
    assert np.abs(first - second).max() > 0.001
    take_rows = rows(addon, ob)
    assert {name: row.state for name, row in take_rows.items()} == {
        "Take 1": "WAITS",
        "Take 2": "PLAYS",
    }
    for name, face in (("Take 1", first), ("Take 2", second), ("Take 1", first)):
        assert bpy.ops.anyface.take_switch(take=take_rows[name].id) == {"FINISHED"}
        assert np.abs(shape(ob, START + 20) - face).max() < 1e-6
    bpy.context.scene.frame_set(1)
    for name in ("Take 2", "Take 1"):
        assert bpy.ops.anyface.take_delete(take=take_rows[name].id) == {"FINISHED"}
    bpy.context.scene.frame_set(1)
    assert everything() == before


@pytest.mark.parametrize("artist", ARTISTS)
def test_takes_pushed_down_add_up_in_the_nla(addon, stage, tmp_path, artist):
    ob = ready(tmp_path)
    artist(ob)
    bpy.context.scene.frame_set(1)
    before = everything()
    base = shape(ob, START + 20)
    first, second = two_takes(stage, ob)
    take_rows = rows(addon, ob)
    for row in take_rows.values():
        assert bpy.ops.anyface.take_push_down(take=row.id) == {"FINISHED"}
    tracks = ob.data.shape_keys.animation_data.nla_tracks
    assert [track.name for track in tracks] == ["Anyface Rest", "Take 1", "Take 2"]
    assert np.abs(shape(ob, START + 20) - (first + second - base)).max() < 1e-5
    strip = tracks[2].strips[0]
    strip.use_animated_influence = True
    strip.fcurves.find("influence").keyframe_points[0].co[1] = 0.25
    blended = first + 0.25 * (second - base)
    assert np.abs(shape(ob, START + 20) - blended).max() < 1e-5
    tracks[2].mute = True
    assert np.abs(shape(ob, START + 20) - first).max() < 1e-5
    tracks[2].mute = False
    bpy.ops.anyface.take_switch(take=take_rows["Take 2"].id)
    assert len(tracks) == 2 and rows(addon, ob)["Take 2"].state == "PLAYS"
    assert np.abs(shape(ob, START + 20) - (first + second - base)).max() < 1e-5
    for row in take_rows.values():
        bpy.ops.anyface.take_delete(take=row.id)
    bpy.context.scene.frame_set(1)
    assert everything() == before


def test_takes_are_renamed_and_survive_saving(addon, stage, tmp_path):
    ob = ready(tmp_path)
    first, second = two_takes(stage, ob)
    bpy.ops.anyface.take_rename(take=rows(addon, ob)["Take 1"].id, name="Shy")
    assert "Head Shy" in bpy.data.actions
    path = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    ob = bpy.data.objects["Head"]
    bpy.context.view_layer.objects.active = ob
    assert np.abs(shape(ob, START + 20) - second).max() < 1e-6
    bpy.ops.anyface.take_switch(take=rows(addon, ob)["Shy"].id)
    assert np.abs(shape(ob, START + 20) - first).max() < 1e-6
    with pytest.raises(RuntimeError, match="expected a name"):
        bpy.ops.anyface.take_rename(take=rows(addon, ob)["Shy"].id, name=" ")


def test_without_new_take_only_the_playing_one_is_replaced(addon, stage, tmp_path):
    ob = ready(tmp_path)
    first, _ = two_takes(stage, ob)
    ob.anyface_output.new_take = False
    stage.size = 0.002
    bpy.ops.anyface.generate()
    take_rows = rows(addon, ob)
    assert list(take_rows) == ["Take 1", "Take 2"]
    bpy.ops.anyface.take_switch(take=take_rows["Take 1"].id)
    assert np.abs(shape(ob, START + 20) - first).max() < 1e-6
    bpy.ops.anyface.remove()
    assert list(rows(addon, ob)) == ["Take 2"]


def test_takes_of_existing_keys_switch_between_actions(addon, stage, tmp_path):
    ob = ready(tmp_path)
    artist_curves(ob)
    block = ob.data.shape_keys.key_blocks["jawOpen"]
    vector = stage.rig(np.zeros((144, 3)), None, None, None, None, Silent()).vectors[0]
    base = np.array([vertex.co for vertex in ob.data.vertices])
    block.points.foreach_set("co", (base + vector).astype(np.float32).ravel())
    block.keyframe_insert("value", frame=1)
    bpy.context.scene.frame_set(1)
    before = everything()
    ob.anyface.mode = "keys"
    first, second = two_takes(stage, ob)
    take_rows = rows(addon, ob)
    for name, face in (("Take 1", first), ("Take 2", second)):
        bpy.ops.anyface.take_switch(take=take_rows[name].id)
        assert np.abs(shape(ob, START + 20) - face).max() < 1e-6
    for row in take_rows.values():
        bpy.ops.anyface.take_delete(take=row.id)
    bpy.context.scene.frame_set(1)
    assert everything() == before


class Silent:
    def check(self, *_):
        """Never cancels."""


def test_one_key_per_frame_takes_no_company(addon, stage, tmp_path):
    ob = ready(tmp_path)
    ob.anyface.mode = "frames"
    bpy.ops.anyface.generate()
    with pytest.raises(RuntimeError, match="cannot wait"):
        bpy.ops.anyface.take_keep()
    ob.anyface.mode = "basis"
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    two_takes(stage, ob)
    ob.anyface.mode = "frames"
    with pytest.raises(RuntimeError, match="other takes"):
        bpy.ops.anyface.generate()


def correct(ob):
    """Moves a keyframe of the take by hand."""
    action = ob.data.shape_keys.animation_data.action
    curve = next(curve for curve in curves(action) if "Anyface" in curve.data_path)
    curve.keyframe_points[3].co.y += 0.2
    curve.update()


def test_a_take_that_was_corrected_by_hand_is_kept_when_another_is_made(addon, stage, tmp_path):
    ob = ready(tmp_path)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    correct(ob)
    corrected = shape(ob, START + 3)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    name, kept = next((n, row) for n, row in rows(addon, ob).items() if row.state == "WAITS")
    assert f"the take with your corrections waits in Takes as {name}" in ob.anyface.report
    assert len(rows(addon, ob)) == 2
    addon("scene.takes.take_list").switch(ob, kept.id)
    assert np.abs(shape(ob, START + 3) - corrected).max() < 1e-6


def test_a_take_that_nobody_corrected_is_replaced(addon, stage, tmp_path):
    """Also after changes by Anyface itself and after the file was saved."""
    ob = ready(tmp_path)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    addon("scene.takes.adjust").adjust(ob, strength=0.7, shift=2.0)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    ob = bpy.context.view_layer.objects.active
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert [row.state for row in rows(addon, ob).values()] == ["PLAYS"]


def test_a_correction_after_a_change_of_strength_still_counts(addon, stage, tmp_path):
    ob = ready(tmp_path)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    correct(ob)
    addon("scene.takes.adjust").adjust(ob, strength=0.7)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert sorted(row.state for row in rows(addon, ob).values()) == ["PLAYS", "WAITS"]
