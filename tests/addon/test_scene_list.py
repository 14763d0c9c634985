"""Generates a whole scene with one press."""

import bpy
import numpy as np
import pytest

from figures import everything, grid, own_keys, shape, stand_in, strip, tone

NAMES = ("Ann", "Bob", "Cy")


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def scene_of_three(tmp_path, addon):
    """Three heads with different meshes and strips, in the list of the scene."""
    for number, name in enumerate(NAMES):
        path = tone(tmp_path / f"{name}.wav", seconds=1.0 + number, hertz=200 + 50 * number)
        try:
            strip(path, name=f"Voice {name}", frame=3 + 20 * number, channel=number + 1)
        except RuntimeError as error:
            pytest.skip(str(error).strip())
        ob = grid(name, side=8 + number)
        ob.anyface.strip, ob.anyface.seed = f"Voice {name}", number
        ob.location.x = number
    own_keys(bpy.data.objects["Bob"], "Smile")
    bpy.data.objects["Cy"].anyface.mode = "frames"
    bpy.context.view_layer.update()
    assert bpy.ops.anyface.scene_fill() == {"FINISHED"}
    return bpy.context.scene.anyface_list


def faces():
    return {
        (name, frame): shape(bpy.data.objects[name], frame)
        for name in NAMES
        for frame in (1, 10, 30, 60)
    }


def test_all_at_once_is_the_same_as_one_by_one(addon, stage, tmp_path):
    rows = scene_of_three(tmp_path, addon)
    assert [row.character.name for row in rows] == list(NAMES)
    bpy.context.scene.frame_set(1)
    before = everything()
    for name in NAMES:
        bpy.context.view_layer.objects.active = bpy.data.objects[name]
        assert bpy.ops.anyface.generate() == {"FINISHED"}
    one_by_one, rows_one_by_one = faces(), everything()
    for name in NAMES:
        bpy.context.view_layer.objects.active = bpy.data.objects[name]
        bpy.ops.anyface.remove()
    bpy.context.scene.frame_set(1)
    assert everything() == before
    assert bpy.ops.anyface.generate_scene() == {"FINISHED"}
    together = faces()
    for place, face in one_by_one.items():
        assert np.array_equal(together[place], face), place
    assert everything() == rows_one_by_one
    moved = together["Ann", 10] - together["Ann", 1]
    assert np.abs(moved).max() > 1e-3


def test_one_that_cannot_be_animated_keeps_no_other_from_it(addon, stage, tmp_path):
    rows = scene_of_three(tmp_path, addon)
    rows[1].strip = "Nobody"
    rows[2].use = False
    assert bpy.ops.anyface.generate_scene() == {"FINISHED"}
    ann, bob, cy = (bpy.data.objects[name] for name in NAMES)
    assert ann.data.shape_keys is not None and cy.data.shape_keys is None
    assert bob.anyface.report_is_error and "Nobody" in bob.anyface.report
    rows[0].use = False
    with pytest.raises(RuntimeError, match="0 of 1 animated; Bob"):
        bpy.ops.anyface.generate_scene()


def test_a_row_goes_and_the_others_stay(addon, stage, tmp_path):
    rows = scene_of_three(tmp_path, addon)
    assert bpy.ops.anyface.scene_row_remove(number=1) == {"FINISHED"}
    assert [row.character.name for row in rows] == ["Ann", "Cy"]
    bpy.ops.anyface.generate_scene()
    assert not bpy.data.objects["Ann"].anyface.report_is_error
