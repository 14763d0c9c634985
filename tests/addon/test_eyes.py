"""Open Eyes cuts eyes free that are one surface with their lids. Textures stay in place."""

import json

import bpy
import numpy as np
import pytest

from figures import babble
from test_mouth import mask  # noqa: F401


def _lids(ob) -> list:
    return json.loads(ob["anyface_landmarks"])["lids"]


@pytest.fixture
def face(mask):  # noqa: F811
    """The mask after Find Face."""
    assert bpy.ops.anyface.find_face() == {"FINISHED"}
    assert _lids(mask) == ["joined", "joined"]
    return mask


def test_the_eyes_are_cut_free_and_everything_goes_along(face):
    before = np.array([vertex.co for vertex in face.data.vertices])
    materials = len(face.data.materials)
    assert bpy.ops.anyface.open_eyes() == {"FINISHED"}
    data = face.data
    after = np.array([vertex.co for vertex in data.vertices])
    assert len(after) > len(before) + 500
    assert np.abs(after[: len(before)] - before).max() < 1e-7
    assert len(data.materials) == materials
    assert _lids(face) == ["close", "close"]
    layer = data.uv_layers["UVMap"].data
    for polygon in data.polygons:
        uvs = [tuple(layer[loop].uv) for loop in polygon.loop_indices]
        if len(set(uvs)) == 1:
            continue  # Behind the cut: has the colour of the rim in front of it.
        for loop in polygon.loop_indices:
            place = data.vertices[data.loops[loop].vertex_index].co
            assert abs(layer[loop].uv.x - place.x) < 1e-5
    assert not any(edge.is_loose for edge in data.edges)
    assert not bpy.ops.anyface.open_eyes.poll()
    assert bpy.ops.anyface.find_face() == {"FINISHED"}
    assert _lids(face) == ["close", "close"]


def test_a_take_offers_it_where_eyes_cannot_blink(mask, addon, tmp_path):  # noqa: F811
    mask.anyface.source, mask.anyface.sound_file = "FILE", babble(tmp_path / "voice.wav", 1.0)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert addon("scene.face.opening").JOINED in mask.anyface.report
    assert addon("ui.mending").offers(mask) == ["open_mouth", "open_eyes"]
