"""Add > Mesh > Anyface Sample Heads: the default head of the library and three characters."""

import importlib.util

import bpy
import numpy as np
import pytest

from conftest import ROOT


def packed():
    path = ROOT / "training" / "sample_head.py"
    spec = importlib.util.spec_from_file_location("sample_head", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_packed_head_is_the_default_head():
    module = packed()
    with np.load(module.PACKED) as arrays:
        for name, values in module.read(module.HEAD).items():
            assert np.array_equal(arrays[name], values), name
    assert module.PACKED.stat().st_size < 200_000


def test_it_stands_upright_at_the_cursor_and_is_the_face_of_the_panel(addon):
    bpy.context.scene.cursor.location = (1.0, 2.0, 3.0)
    assert bpy.ops.anyface.add_sample_head() == {"FINISHED"}
    ob = bpy.context.object
    assert addon("ui.target").target(bpy.context) == ob
    assert tuple(ob.location) == (1.0, 2.0, 3.0)
    assert np.isclose(ob.dimensions.z, 2.0)
    assert len(ob.data.vertices) == 8510 and not ob.data.validate()
    centres = np.array([polygon.center for polygon in ob.data.polygons])
    names = [slot.material.name for slot in ob.material_slots]
    by_name = {
        name.split()[-1]: centres[[p.material_index == n for p in ob.data.polygons]].mean(axis=0)
        for n, name in enumerate(names)
    }
    # It looks along -Y: the pupils are in front of the teeth and above the lips.
    assert by_name["pupil"][1] < by_name["teeth"][1] < centres[:, 1].max()
    assert by_name["pupil"][2] > by_name["lips"][2]
    outward = sum(p.normal.y < 0 for p in ob.data.polygons if p.center.y < -0.5)
    assert outward > 0.7 * sum(p.center.y < -0.5 for p in ob.data.polygons)


def test_its_height_can_be_chosen_and_edit_mode_is_refused(addon):
    bpy.ops.anyface.add_sample_head(height=0.38)
    assert np.isclose(bpy.context.object.dimensions.z, 0.38)
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.anyface.add_sample_head.poll()
    bpy.ops.object.mode_set(mode="OBJECT")


def test_it_speaks(addon, tmp_path):
    from figures import stand_in
    from test_first_minutes import heard

    stand_in(addon)
    bpy.ops.anyface.add_sample_head()
    heard(tmp_path, bpy.context.object)
    assert bpy.ops.anyface.generate() == {"FINISHED"}


@pytest.mark.parametrize("character", ["WOMAN", "MAN", "CARTOON"])
def test_a_character_has_a_face_and_hair_that_follows_it(addon, character):
    bpy.context.scene.cursor.location = (1.0, 2.0, 3.0)
    assert bpy.ops.anyface.add_sample_head(character=character, height=0.4) == {"FINISHED"}
    ob = bpy.context.object
    assert np.isclose(ob.dimensions.z, 0.4, atol=1e-3) and not ob.data.validate()
    assert addon("scene.face.landmarks").load(ob) is not None
    (hair,) = ob.children
    assert hair.location.length == 0.0 and not hair.data.validate()
    head, cap = corners(ob), corners(hair)
    # The hair covers the crown and the back of the head and leaves the lower half of the face free.
    assert cap[:, 2].max() > head[:, 2].max() and cap[:, 1].max() > head[:, 1].mean()
    front = cap[cap[:, 1] < np.median(head[:, 1])]
    assert (front[:, 2] > head[:, 2].mean()).all()


def corners(ob):
    points = np.empty(len(ob.data.vertices) * 3)
    ob.data.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def test_eyes_of_the_cartoon_are_larger(addon):
    widths = []
    for character in ("WOMAN", "CARTOON"):
        bpy.ops.anyface.add_sample_head(character=character)
        face = addon("scene.face.landmarks").load(bpy.context.object)
        widths.append(np.linalg.norm(face.positions[36] - face.positions[39]))
    assert widths[1] > 1.2 * widths[0]
