"""Characters on rigs, made from the default head."""

import json

import bpy
import numpy as np

from conftest import ROOT

HEAD = ROOT / "weights" / "shared" / "default_head" / "head.obj"
LANDMARKS = json.loads((HEAD.parent / "landmarks.json").read_text())["landmarks"]
# Bones of a crude face and the landmark at which each lies.
LIPS = {"lip.T": 51, "lip.T.L": 53, "lip.T.R": 49, "lip.L": 54, "lip.R": 48, "lip.B": 57,
        "lip.B.L": 55, "lip.B.R": 59}  # fmt: skip
LIDS = {"lid.T.L": 44, "lid.T.R": 37, "lid.B.L": 46, "lid.B.R": 41}
BROWS = {"brow.in.L": 22, "brow.in.R": 21, "brow.out.L": 24, "brow.out.R": 19}
SNEERS = {"sneer.L": 35, "sneer.R": 31}
UPPER = LIDS | BROWS | SNEERS
# How far a bone reaches, metres on a head of human size.
REACH_M = 0.011


def head():
    """The default head with its landmarks stored, in metres."""
    bpy.ops.wm.obj_import(filepath=str(HEAD), use_split_objects=False, use_split_groups=False)
    ob = bpy.context.object
    ob.name = "Head"
    bpy.context.view_layer.update()
    return ob


def landmarks():
    """Positions `[68, 3]` of the head's landmarks in object space."""
    return np.array([row["position"] for row in LANDMARKS], dtype=np.float64)


def skin_vertices():
    """How many vertices the skin has; eyes, teeth and tongue come after it."""
    rows = HEAD.read_text().splitlines()
    later = [at for at, row in enumerate(rows) if row.startswith("o ")][1:]
    return sum(row.startswith("v ") for row in rows[: later[0] if later else len(rows)])


def positions(ob):
    """Positions `[V, 3]` of the mesh of `ob`."""
    flat = np.empty(len(ob.data.vertices) * 3)
    ob.data.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def shapes(addon, ob):
    """The ARKit shapes of a head by name, `[V, 3]` each in object space."""
    scene, job = addon("scene.bake"), addon("core.job")
    settings = addon("ui.settings").from_object(ob)
    face = scene.read_face(ob, settings, editable=False)
    engine = addon("ui.running").engine(settings.system)
    rig = addon("core.plan").make_rig(face, engine, job.Progress())
    return dict(zip(rig.names, rig.vectors, strict=True))


def jaw_share(vectors):
    """How much each vertex goes with the jaw, 0 to 1 `[V]`."""
    size = np.linalg.norm(vectors["jawOpen"], axis=1)
    return np.clip(size / np.quantile(size[size > 0.2 * size.max()], 0.7), 0.0, 1.0)


def armature(ob, places, parents):
    """Makes an armature at `ob`.

    `places` gives the head and tail `[3]` of each bone by name, in the space of `ob`. `parents`
    gives the name of its parent.
    """
    data = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", data)
    bpy.context.scene.collection.objects.link(rig)
    rig.matrix_world = ob.matrix_world
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for name, (place, tip) in places.items():
        bone = data.edit_bones.new(name)
        bone.head, bone.tail = place, tip
    for name, parent in parents.items():
        data.edit_bones[name].parent = data.edit_bones[parent]
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.objects.active = ob
    return rig


def skin(ob, rig, weights):
    """Adds an Armature modifier, and weights `[V]` for each bone."""
    for name, values in weights.items():
        group = ob.vertex_groups.new(name=name)
        for vertex in np.flatnonzero(values > 1e-3):
            group.add([int(vertex)], float(values[vertex]), "REPLACE")
    ob.modifiers.new("Armature", "ARMATURE").object = rig


def crude(addon, ob):
    """Binds `ob` to a simple rig. Returns the rig's object.

    It has a jaw that turns within a limit, bones for lips, lids and brows, and a key that a
    property of the armature drives.
    """
    points, marks, vectors = positions(ob), landmarks(), shapes(addon, ob)
    ear = (marks[0] + marks[16]) / 2
    forward = (marks[30] - ear) / np.linalg.norm(marks[30] - ear)
    places = {"head": (ear, ear + 0.1 * (marks[27] - marks[8])), "jaw": (ear, marks[8])}
    for name, number in (LIPS | UPPER).items():
        places[name] = (marks[number], marks[number] + 0.01 * forward)
    low = {"lip.B", "lip.B.L", "lip.B.R", "lip.L", "lip.R"}
    parents = {name: "jaw" if name in low else "head" for name in places if name != "head"}
    rig = armature(ob, places, parents)
    skin(ob, rig, _weights(points, marks, jaw_share(vectors)))
    limit = rig.pose.bones["jaw"].constraints.new("LIMIT_ROTATION")
    limit.owner_space = "LOCAL"
    limit.use_limit_y, limit.use_limit_z = True, True
    limit.min_y = limit.min_z = -0.05
    limit.max_y = limit.max_z = 0.05
    driven_key(ob, rig, "smile", vectors["mouthSmileLeft"] + vectors["mouthSmileRight"])
    return rig


def controllers(addon, ob):
    """The crude rig as Auto-Rig Pro and similar tools build theirs. Returns its object.

    Every bone but the head follows a controller of its own, named c_…, by a constraint.
    """
    rig = crude(addon, ob)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bones = rig.data.edit_bones
    names = [bone.name for bone in bones if bone.name != "head"]
    for name in names:
        controller, bone = bones.new(f"c_{name}"), bones[name]
        controller.head, controller.tail, controller.roll = bone.head, bone.tail, bone.roll
        controller.use_deform = False
    for name in names:
        above = bones[name].parent
        bones[f"c_{name}"].parent = bones.get(f"c_{above.name}") or above
    bpy.ops.object.mode_set(mode="OBJECT")
    jaw = rig.pose.bones["jaw"]
    for constraint in list(jaw.constraints):
        jaw.constraints.remove(constraint)
    for name in names:
        follow = rig.pose.bones[name].constraints.new("COPY_TRANSFORMS")
        follow.target, follow.subtarget = rig, f"c_{name}"
    bpy.context.view_layer.objects.active = ob
    return rig


# VRoid's keys as approximate sums of ARKit shapes.
_VRM = {
    "Fcl_MTH_A": {"jawOpen": 0.7, "mouthLowerDownLeft": 0.3, "mouthLowerDownRight": 0.3},
    "Fcl_MTH_I": {"jawOpen": 0.15, "mouthStretchLeft": 0.6, "mouthStretchRight": 0.6},
    "Fcl_MTH_U": {"jawOpen": 0.15, "mouthPucker": 0.7},
    "Fcl_MTH_E": {"jawOpen": 0.35, "mouthStretchLeft": 0.3, "mouthStretchRight": 0.3},
    "Fcl_MTH_O": {"jawOpen": 0.45, "mouthFunnel": 0.7},
    "Fcl_EYE_Close": {"eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0},
    "Fcl_EYE_Close_L": {"eyeBlinkLeft": 1.0},
    "Fcl_EYE_Close_R": {"eyeBlinkRight": 1.0},
    "Fcl_BRW_Surprised": {"browInnerUp": 0.8, "browOuterUpLeft": 0.8, "browOuterUpRight": 0.8},
    "Fcl_BRW_Angry": {"browDownLeft": 1.0, "browDownRight": 1.0},
    "Fcl_MTH_Fun": {"mouthSmileLeft": 0.7, "mouthSmileRight": 0.7},
}


def vroid(addon, ob):
    """Adds shape keys as VRoid's characters have them. Nothing drives them."""
    vectors = shapes(addon, ob)
    ob.shape_key_add(name="Basis", from_mix=False)
    for name, parts in _VRM.items():
        block = ob.shape_key_add(name=name, from_mix=False)
        moved = positions(ob) + sum(share * vectors[shape] for shape, share in parts.items())
        block.points.foreach_set("co", moved.astype(np.float32).ravel())
    return ob


def driven_key(ob, rig, name, vector):
    """Adds a key that a custom property of `rig`, 0 to 1, drives."""
    if ob.data.shape_keys is None:
        ob.shape_key_add(name="Basis", from_mix=False)
    block = ob.shape_key_add(name=name, from_mix=False)
    block.value = 0.0
    points = positions(ob) + vector
    block.points.foreach_set("co", points.astype(np.float32).ravel())
    rig[name] = 0.0
    rig.id_properties_ui(name).update(min=0.0, max=1.0, soft_min=0.0, soft_max=1.0)
    driver = block.driver_add("value").driver
    driver.type = "AVERAGE"
    variable = driver.variables.new()
    variable.targets[0].id = rig
    variable.targets[0].data_path = f'["{name}"]'
    return block


def _weights(points, marks, jaw):
    """Weights that add up to 1. Jaw and head get the share that the small bones leave."""
    near = {}
    for name, number in (LIPS | UPPER).items():
        away = np.linalg.norm(points - marks[number], axis=1)
        near[name] = np.exp(-0.5 * (away / REACH_M) ** 2)
        if name.startswith(("lip.T", "lid.T")):
            near[name] *= 1.0 - jaw
        elif name.startswith("lip.B"):
            near[name] *= jaw
    total = np.sum(list(near.values()), axis=0)
    scale = 1.0 / np.maximum(total, 1.0)
    rest = 1.0 - np.minimum(total, 1.0)
    weights = {name: values * scale for name, values in near.items()}
    return weights | {"jaw": rest * jaw, "head": rest * (1.0 - jaw)}


def driven(addon, ob):
    """Adds ARKit shapes as keys, each driven by its own custom property of an armature.

    So nobody can animate the keys themselves. Returns the armature's object.
    """
    vectors = shapes(addon, ob)
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    for name, vector in vectors.items():
        if name.startswith("viseme") or not vector.any():
            continue
        driven_key(ob, rig, name, vector)
    return rig
