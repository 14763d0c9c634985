"""The default head on the face rig that Blender's own Rigify makes."""

import contextlib
import io

import addon_utils
import bpy
import numpy as np

import rigs

# Joints of the metarig and the landmark at which each lies; several landmarks stand for their mean.
# "bone" is the head of that bone, "bone|" its tail. Left joints also hold for the right side.
_MIDDLE = {"nose": (27,), "nose.002": (30,), "nose.004|": (33,), "lip.T.L": (51, 62),
           "lip.B.L": (57, 66), "chin": (8,)}  # fmt: skip
_LEFT = {"lip.T.L.001": (52, 63), "lip.T.L.001|": (54,), "lip.B.L.001": (56, 65), "lid.T.L": (45,),
         "lid.T.L.002": (43, 44), "lid.B.L": (42,), "lid.B.L.002": (46, 47), "brow.T.L.001": (26,),
         "brow.T.L.002": (24,), "brow.T.L.003": (23,), "brow.T.L.003|": (22,), "jaw.L": (15,),
         "jaw.L.001": (13,), "chin.L": (10,)}  # fmt: skip
_MIRRORED = {15: 1, 13: 3, 10: 6, 52: 50, 63: 61, 54: 48, 56: 58, 65: 67, 45: 36, 43: 38, 44: 37,
             42: 39, 46: 41, 47: 40, 26: 17, 24: 19, 23: 20, 22: 21}  # fmt: skip
_FALL_M = 0.007


def enable():
    """Turns Rigify on, quietly."""
    with contextlib.redirect_stdout(io.StringIO()):
        return addon_utils.enable("rigify", default_set=True)


def disable():
    """Turns Rigify off again."""
    with contextlib.redirect_stdout(io.StringIO()):
        addon_utils.disable("rigify", default_set=True)


def bind(addon, ob, whole=False):
    """Binds `ob` to a generated Rigify face, with weights by distance. Returns the rig.

    The rig has limbs and fingers only if `whole`.
    """
    meta = _metarig(whole)
    places = _world(ob, rigs.landmarks())
    _fit(meta, places)
    bpy.context.view_layer.objects.active = meta
    with contextlib.redirect_stdout(io.StringIO()):
        bpy.ops.pose.rigify_generate()
    rig = bpy.context.object
    bpy.data.objects.remove(meta)
    rig.name = "Rigify"
    jaw = rigs.jaw_share(rigs.shapes(addon, ob))
    rigs.skin(ob, rig, _weights(rig, _world(ob, rigs.positions(ob)), jaw))
    bpy.context.view_layer.objects.active = ob
    return rig


def _world(ob, points):
    matrix = np.array(ob.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _metarig(whole):
    """The human metarig, without limbs unless `whole`."""
    bpy.ops.object.armature_human_metarig_add()
    meta = bpy.context.object
    if whole:
        return meta
    bpy.ops.object.mode_set(mode="EDIT")
    bones = meta.data.edit_bones
    face = bones["face"]
    keep = {face, *face.children_recursive, *face.parent_recursive}
    for name in [bone.name for bone in bones if bone not in keep]:
        bones.remove(bones[name])
    bpy.ops.object.mode_set(mode="OBJECT")
    return meta


def _joint(bones, name):
    bone = bones[name.rstrip("|")]
    return np.array(bone.tail if name.endswith("|") else bone.head)


def _anchors(bones, places):
    """Joints of the metarig `[N, 3]` and their target positions `[N, 3]`."""
    every = [(name, numbers) for name, numbers in (_MIDDLE | _LEFT).items()]
    every += [(name.replace(".L", ".R"), [_MIRRORED[n] for n in numbers])
              for name, numbers in _LEFT.items()]  # fmt: skip
    source = np.array([_joint(bones, name) for name, _ in every])
    return source, np.array([places[list(numbers)].mean(axis=0) for _, numbers in every])


def _fit(meta, places):
    """Moves every joint of the metarig by a spline that takes its anchors to the landmarks."""
    bpy.context.view_layer.objects.active = meta
    bpy.ops.object.mode_set(mode="EDIT")
    bones = meta.data.edit_bones
    source, aim = _anchors(bones, places)
    # Bones outside the face are only scaled and shifted.
    scale = np.ptp(aim, axis=0).max() / np.ptp(source, axis=0).max()
    alike = scale * (source - source.mean(axis=0)) + aim.mean(axis=0)
    away = np.linalg.norm(source[:, None] - source[None], axis=2)
    weights = np.linalg.solve(away + 1e-9 * np.eye(len(away)), aim - alike)
    inside = {bone.name for bone in bones["face"].children_recursive}

    def moved(point, warp):
        place = scale * (np.array(point) - source.mean(axis=0)) + aim.mean(axis=0)
        spread = np.linalg.norm(np.array(point) - source, axis=1)
        return place + (spread @ weights if warp else 0.0)

    joints = [(bone.name, np.array(bone.head), np.array(bone.tail)) for bone in bones]
    chained = [bone.name for bone in bones if bone.use_connect]
    for bone in bones:
        bone.use_connect = False
    for name, head, tail in joints:
        bones[name].head = moved(head, name in inside)
        bones[name].tail = moved(tail, name in inside)
    for name in chained:
        bones[name].use_connect = True
    bpy.ops.object.mode_set(mode="OBJECT")


def _weights(rig, points, jaw):
    """Weights by distance to the deform bones. Lower bones get the share that follows the jaw."""
    near = {}
    for bone in rig.data.bones:
        if not bone.use_deform or bone.name.startswith(("DEF-spine", "DEF-eye", "DEF-ear")):
            continue
        if bone.name.startswith(("DEF-tongue", "DEF-teeth", "DEF-shoulder", "DEF-pelvis")):
            continue
        near[bone.name] = np.exp(-0.5 * (_away(points, bone) / _FALL_M) ** 2) + 1e-9
        lower = bone.name.startswith(("DEF-lip.B", "DEF-chin", "DEF-jaw"))
        upper = bone.name.startswith(("DEF-lip.T", "DEF-nose", "DEF-lid", "DEF-brow"))
        near[bone.name] *= jaw if lower else 1.0 - jaw if upper else 1.0
    total = np.sum(list(near.values()), axis=0)
    scale = 1.0 / np.maximum(total, 1.0)
    weights = {name: values * scale for name, values in near.items()}
    head, rest = _head(rig), 1.0 - np.minimum(total, 1.0)
    jaws = [name for name in near if name.startswith("DEF-jaw")]
    weights[jaws[0]] = weights[jaws[0]] + rest * jaw
    return weights | {head: rest * (1.0 - jaw)}


def _head(rig):
    return max(bone.name for bone in rig.data.bones if bone.name.startswith("DEF-spine"))


def _away(points, bone):
    """Distance `[V]` of points to a bone."""
    head, tail = np.array(bone.head_local), np.array(bone.tail_local)
    along = tail - head
    share = np.clip((points - head) @ along / max(along @ along, 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - head - share[:, None] * along, axis=1)
