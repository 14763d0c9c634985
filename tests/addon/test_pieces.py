"""Teeth and eyes as separate objects, on a real head with the real library."""

import bpy
import numpy as np

from figures import everything, shape
from test_heads import LANDMARKS, import_head, loudest_s, ready, voice  # noqa: F401 - a fixture


def place(ob, number, inwards):
    """The world position of a landmark, moved into the head by `inwards` metres."""
    return ob.matrix_world @ ob.data.vertices[LANDMARKS[number]["vertex"]].co + _along_y(inwards)


def _along_y(metres):
    from mathutils import Vector

    return Vector((0.0, metres, 0.0))


def with_parts(ob):
    """Adds lower teeth and an eyeball as separate objects in the collection of the head."""
    bpy.ops.mesh.primitive_cube_add(size=0.02, location=place(ob, 66, 0.02))
    teeth = bpy.context.object
    teeth.name = "Teeth_lower"
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.01, location=place(ob, 37, 0.015))
    eye = bpy.context.object
    eye.name = "Eye.R"
    bpy.context.view_layer.objects.active = ob
    bpy.context.view_layer.update()
    return teeth, eye


def test_lower_teeth_turn_with_the_jaw_and_eyes_rest(voice):  # noqa: F811
    path, samples, rate = voice
    ob = ready(import_head(), path)
    teeth, eye = with_parts(ob)
    bpy.ops.anyface.find_parts()
    before = everything()
    roles = {part.object.name: part.role for part in ob.anyface_face.parts}
    assert roles == {"Eye.R": "gaze", "Teeth_lower": "jaw"}
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert eye.data.shape_keys is None
    vowel, pause = 1 + loudest_s(samples, rate) * 24, -30
    rest, moved = shape(teeth, pause), shape(teeth, vowel)
    assert np.linalg.norm(moved - rest, axis=1).max() > 0.002
    edges = rest[:, None] - rest[None]
    turned = moved[:, None] - moved[None]
    stretch = np.abs(np.linalg.norm(turned, axis=2) - np.linalg.norm(edges, axis=2)).max()
    assert stretch < 0.0003
    bpy.context.scene.frame_set(1)
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert everything() == before


def test_the_role_of_an_object_can_be_overridden(voice):  # noqa: F811
    ob = ready(import_head(), voice[0])
    teeth, _ = with_parts(ob)
    bpy.ops.anyface.find_parts()
    for part in ob.anyface_face.parts:
        part.role = "still"
    bpy.ops.anyface.generate()
    assert teeth.data.shape_keys is None and ob.data.shape_keys is not None
