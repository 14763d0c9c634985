"""Add > Mesh > Anyface Head: a head made from numbers, whose landmarks are known."""

import bpy
import numpy as np
import pytest


def points(ob) -> np.ndarray:
    """Positions of the vertices, `[V, 3]`."""
    out = np.empty(len(ob.data.vertices) * 3, dtype=np.float32)
    ob.data.vertices.foreach_get("co", out)
    return out.reshape(-1, 3)


def test_it_stands_upright_at_the_cursor_and_knows_its_landmarks(addon):
    bpy.context.scene.cursor.location = (1.0, 2.0, 3.0)
    assert bpy.ops.anyface.add_head(seed=7) == {"FINISHED"}
    ob = bpy.context.object
    assert tuple(ob.location) == (1.0, 2.0, 3.0)
    assert np.isclose(ob.dimensions.z, 2.0) and not ob.data.validate()
    stored = addon("scene.face.landmarks").load(ob)
    assert stored.sure == 1.0
    places = points(ob)
    apart = np.linalg.norm(places[:, None] - stored.positions[None], axis=2).min(axis=0)
    assert apart.max() < 1e-6, "every landmark is a vertex"
    # It looks along -Y: the nose is in front of the ears, the brows are above the chin.
    assert stored.positions[30, 1] < stored.positions[[0, 16], 1].min()
    assert stored.positions[19, 2] > stored.positions[8, 2]
    names = {ob.material_slots[p.material_index].material.name for p in ob.data.polygons}
    assert (
        len([name for name in names if name.endswith(("pupil", "teeth", "tongue", "brows"))]) == 4
    )
    corners = [len(face.vertices) for face in ob.data.polygons if face.material_index == 0]
    assert set(corners) == {4}, "skin is quads"
    places = np.empty(2 * len(ob.data.loops), dtype=np.float32)
    ob.data.uv_layers["UVMap"].data.foreach_get("uv", places)
    assert np.ptp(places) > 0.9, "and has texture places"


def test_seeds_mixtures_and_sliders_make_other_heads(addon):
    def jaw(**options):
        bpy.ops.anyface.add_head(**options)
        return addon("scene.face.landmarks").load(bpy.context.object).positions

    one, other = jaw(seed=3), jaw(seed=4)
    assert np.abs(one - other).max() > 0.01
    assert np.array_equal(jaw(seed=3), one), "the same numbers, the same head"
    half = jaw(seed=3, other=4, share=0.5)
    assert 0.0 < np.abs(half - one).max() < np.abs(other - one).max()
    sliders = addon("ui.made_head").heads().directions()
    assert len(sliders) == addon("ui.made_head").SLIDERS
    for number in (sliders.index("age"), sliders.index("weight"), len(sliders) - 1):
        changes = [0.0] * len(sliders)
        changes[number] = 2.0
        assert np.abs(jaw(seed=3, changes=changes) - one).max() > 0.005, sliders[number]


def test_one_undo_step_takes_it_away_and_edit_mode_is_refused(addon):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.anyface.add_head()
    bpy.ops.ed.undo_push(message="head")
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.anyface.add_head.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.ed.undo()
    assert not [ob for ob in bpy.data.objects if ob.type == "MESH"]


def test_without_the_library_it_says_so(addon, monkeypatch):
    monkeypatch.setenv("ANYFACE_LIBRARY", "/nowhere/libanyface.so")
    monkeypatch.setattr(addon("ui.add_head"), "_HEADS", [])
    with pytest.raises(RuntimeError, match="the native library cannot be used"):
        bpy.ops.anyface.add_head()
    assert not bpy.data.meshes


def test_it_speaks_without_a_search(addon, tmp_path):
    from test_first_minutes import heard

    bpy.ops.anyface.add_head()
    ob = bpy.context.object
    before = dict(ob.items())["anyface_landmarks"]
    heard(tmp_path, ob)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert len(ob.data.shape_keys.key_blocks) > 1
    assert dict(ob.items())["anyface_landmarks"] == before, "what was known stays"


def test_a_head_like_a_mesh_stands_beside_it_and_the_mesh_stays(addon):
    bpy.ops.anyface.add_head(seed=7, height=0.3)
    ob = bpy.context.object
    ob.rotation_euler.z, ob.location = 0.4, (1.0, 0.0, 2.0)
    bpy.context.view_layer.update()
    before = points(ob)
    assert bpy.ops.anyface.head_like() == {"FINISHED"}
    new = bpy.context.object
    assert new is not ob and np.array_equal(points(ob), before)
    assert new.users_collection == ob.users_collection
    bpy.context.view_layer.update()
    assert 0.9 < new.dimensions.z / ob.dimensions.z < 1.1
    assert new.location.x - ob.location.x > 0.1 and abs(new.location.z - 2.0) < 0.05
    load = addon("scene.face.landmarks").load
    marks, truth = load(new).positions, load(ob).positions
    apart = np.linalg.norm((marks - marks.mean(axis=0)) - (truth - truth.mean(axis=0)), axis=1)
    # The likeness is fitted to the field, which knows no traits.
    assert apart.mean() < 0.006, "a head of 0.3 m"


def test_a_mesh_that_no_head_is_like_is_told_and_nothing_is_added(addon):
    bpy.ops.anyface.add_head(seed=7)
    ob = bpy.context.object
    ob.scale.x = 2.2
    bpy.context.view_layer.update()
    objects, meshes = set(bpy.data.objects), set(bpy.data.meshes)
    with pytest.raises(RuntimeError, match="expected a face"):
        bpy.ops.anyface.head_like()
    assert set(bpy.data.objects) == objects and set(bpy.data.meshes) == meshes
