"""Add > Mesh > Anyface Head: a head made from numbers, whose landmarks are known."""

import bpy
import numpy as np
import pytest

SMALL = {"resolution": 48}


def points(ob) -> np.ndarray:
    """`[V, 3]`."""
    out = np.empty(len(ob.data.vertices) * 3, dtype=np.float32)
    ob.data.vertices.foreach_get("co", out)
    return out.reshape(-1, 3)


def test_it_stands_upright_at_the_cursor_and_knows_its_landmarks(addon):
    bpy.context.scene.cursor.location = (1.0, 2.0, 3.0)
    assert bpy.ops.anyface.add_head(seed=7, **SMALL) == {"FINISHED"}
    ob = bpy.context.object
    assert tuple(ob.location) == (1.0, 2.0, 3.0)
    assert np.isclose(ob.dimensions.z, 2.0) and not ob.data.validate()
    stored = addon("scene.landmarks").load(ob)
    assert stored.sure == 1.0
    places = points(ob)
    apart = np.linalg.norm(places[:, None] - stored.positions[None], axis=2).min(axis=0)
    assert apart.max() < 1e-6, "every landmark is a vertex"
    # It looks along -Y: the nose lies before the ears, the brows above the chin.
    assert stored.positions[30, 1] < stored.positions[[0, 16], 1].min()
    assert stored.positions[19, 2] > stored.positions[8, 2]
    names = {ob.material_slots[p.material_index].material.name for p in ob.data.polygons}
    assert len([name for name in names if name.endswith(("pupil", "teeth", "tongue"))]) == 3


def test_seeds_mixtures_and_sliders_make_other_heads(addon):
    def jaw(**asked):
        bpy.ops.anyface.add_head(**SMALL, **asked)
        return addon("scene.landmarks").load(bpy.context.object).positions

    one, other = jaw(seed=3), jaw(seed=4)
    assert np.abs(one - other).max() > 0.01
    assert np.array_equal(jaw(seed=3), one), "the same numbers, the same head"
    half = jaw(seed=3, other=4, share=0.5)
    assert 0.0 < np.abs(half - one).max() < np.abs(other - one).max()
    changed = jaw(seed=3, changes=(2.0, *([0.0] * 9)))
    assert np.abs(changed - one).max() > 0.005
    assert len(addon("ui.made_head").heads().directions()) == 10


def test_one_undo_step_takes_it_away_and_edit_mode_is_refused(addon):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.anyface.add_head(**SMALL)
    bpy.ops.ed.undo_push(message="head")
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.anyface.add_head.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.ed.undo()
    assert not [ob for ob in bpy.data.objects if ob.type == "MESH"]


def test_without_the_library_it_says_so(addon, monkeypatch):
    monkeypatch.setenv("ANYFACE_LIBRARY", "/nowhere/libanyface.so")
    monkeypatch.setattr(addon("ui.made_head"), "_HEADS", [])
    with pytest.raises(RuntimeError, match="the native library cannot be used"):
        bpy.ops.anyface.add_head(**SMALL)
    assert not bpy.data.meshes


def test_it_speaks_without_a_search(addon, tmp_path):
    from test_first_minutes import heard

    bpy.ops.anyface.add_head(resolution=64)
    ob = bpy.context.object
    before = dict(ob.items())["anyface_landmarks"]
    heard(tmp_path, ob)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert len(ob.data.shape_keys.key_blocks) > 1
    assert dict(ob.items())["anyface_landmarks"] == before, "what was known stays"
