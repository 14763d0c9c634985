"""*Expression Keys* gives real heads ARKit's shapes as the artist's keys, with the real library."""

import bpy
import numpy as np
import pytest

from figures import everything, own_keys, select, shape
from test_command import points
from test_heads import import_head
from test_pieces import with_parts


def posed(ob, **values):
    """Positions of `ob` with these keys set."""
    for name, value in values.items():
        ob.data.shape_keys.key_blocks[name].value = value
    bpy.context.view_layer.update()
    return shape(ob, 1)


def test_a_face_and_its_parts_get_keys_that_its_own_sliders_move(addon):
    ob = import_head()
    teeth, _ = with_parts(ob)
    bpy.ops.anyface.find_parts()
    select(ob)
    rest, bite = shape(ob, 1), shape(teeth, 1)
    assert bpy.ops.anyface.expression_keys(by="NETWORK") == {"FINISHED"}
    blocks = ob.data.shape_keys.key_blocks
    assert [block.name for block in blocks[1:]] == list(addon("core.shapes").ARKIT)
    assert np.array_equal(shape(ob, 1), rest), "nothing is set yet"
    moved = posed(ob, jawOpen=1.0)
    assert np.linalg.norm(moved - rest, axis=1).max() > 0.01
    assert np.linalg.norm(shape(teeth, 1) - bite, axis=1).max() > 0.01
    assert "jawOpen" in teeth.data.shape_keys.key_blocks
    assert np.abs(posed(ob, jawOpen=0.0) - rest).max() < 1e-6
    assert np.abs(shape(teeth, 1) - bite).max() < 1e-6


def test_bent_shapes_are_the_fields_own_halfway_and_at_their_ends():
    bpy.ops.anyface.add_head(seed=7)
    ob = bpy.context.object
    assert bpy.ops.anyface.expression_keys(by="BENT") == {"FINISHED"}
    blocks = ob.data.shape_keys.key_blocks
    assert len(blocks) == 1 + 2 * 52
    rest, whole = points(blocks[0]), points(blocks["eyeBlinkLeft"])
    lacking = points(blocks["eyeBlinkLeft_half"]) - rest
    way = np.linalg.norm(whole - rest, axis=1).max()
    assert 1e-3 * way < np.linalg.norm(lacking, axis=1).max() < 0.5 * way
    assert np.abs(posed(ob, eyeBlinkLeft=1.0) - whole).max() < 1e-5
    halfway = posed(ob, eyeBlinkLeft=0.5)
    assert np.abs(halfway - (0.5 * (rest + whole) + lacking)).max() < 1e-5
    assert np.abs(posed(ob, eyeBlinkLeft=0.0) - rest).max() < 1e-5


def test_what_cannot_be_made_changes_nothing():
    ob = import_head()
    own_keys(ob, "jawOpen")
    before = everything()
    with pytest.raises(RuntimeError, match="has a key jawOpen of its own"):
        bpy.ops.anyface.expression_keys(by="NETWORK")
    assert everything() == before
    bpy.ops.anyface.add_head(seed=7)
    broad = bpy.context.object
    broad.scale.x = 2.2
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="expected a face"):
        bpy.ops.anyface.expression_keys(by="FIELD")
    assert broad.data.shape_keys is None
