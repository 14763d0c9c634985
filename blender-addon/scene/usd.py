"""Keeps weights within 0 and 1 in a USD file, since importers clamp all others.

Blender calls `on_export` when the stage is complete, before it is saved. The equation in `gltf`
holds here too. Only the file is rewritten; the scene stays as it is.
"""

import importlib.util

import bpy
import numpy as np

from . import outputs
from .face import emotion_mask
from .gltf import STANDING
from .shape_keys import record

_WEIGHTS, _NAMES = "blendShapeWeights", "blendShapes"
_TARGETS, _OF_MESH = "skel:blendShapeTargets", "skel:blendShapes"


def rewrite(stage) -> None:
    """Rewrites weights of basis takes that fall below 0, in all animations of a stage."""
    from pxr import Usd

    ours = _keys_of_takes()
    every = [prim for prim in Usd.PrimRange(stage.GetPseudoRoot()) if prim.IsA("SkelRoot")]
    for root in every:
        prims = list(Usd.PrimRange(root))
        shaped = [prim for prim in prims if prim.HasRelationship(_TARGETS)]
        for animation in prims:
            if animation.GetTypeName() == "SkelAnimation":
                _rewrite(animation, shaped, ours)


def _keys_of_takes() -> dict[str, list[tuple]]:
    """The objects and keys of all basis takes, by the names of the keys in a USD file."""
    from pxr import Tf

    by_name = {}
    for ob in bpy.data.objects:
        shape_keys = ob.data.shape_keys if ob.type == "MESH" and ob.data else None
        for take_record in record.everyone(shape_keys):
            for name in take_record.keys if outputs.of_record(take_record).as_basis else ():
                block = shape_keys.key_blocks.get(name)
                if block is not None:
                    by_name.setdefault(Tf.MakeValidIdentifier(name), []).append((ob, block))
    return by_name


def _rewrite(animation, shaped: list, ours: dict) -> None:
    from pxr import Vt

    names, attribute = animation.GetAttribute(_NAMES), animation.GetAttribute(_WEIGHTS)
    tokens, times = list(names.Get() or ()), attribute.GetTimeSamples()
    rows = [attribute.Get(time) for time in times] or [attribute.Get()]
    if not tokens or any(row is None or len(row) != len(tokens) for row in rows):
        return
    weights = np.array(rows, dtype=np.float64)
    low, high = np.minimum(weights.min(axis=0), 0.0), np.maximum(weights.max(axis=0), 0.0)
    low = np.where([token in ours for token in tokens], low, 0.0)
    changed = {
        token: (a, b if a < 0.0 else 1.0)
        for token, a, b in zip(tokens, low, high, strict=True)
        if a < 0.0 or any(block.vertex_group for _, block in ours.get(token, ()))
    }
    standing = [_rewrite_mesh(mesh, changed, ours) for mesh in shaped]
    if not any(standing):
        return
    weights = np.where(low < 0.0, (weights - low) / np.where(low < 0.0, high - low, 1.0), weights)
    weights = np.hstack([weights, np.ones((len(weights), 1))]).astype(np.float32)
    names.Set([*tokens, _standing()])
    for time, row in zip(times or [None], weights, strict=True):
        attribute.Set(Vt.FloatArray.FromNumpy(row), *([] if time is None else [time]))


def _standing() -> str:
    from pxr import Tf

    return Tf.MakeValidIdentifier(STANDING)


def _rewrite_mesh(mesh, changed: dict, ours: dict) -> bool:
    """Scales the shapes of one mesh, and adds a shape that stays at 1; False if none changes."""
    from pxr import Gf, UsdSkel, Vt

    tokens = list(mesh.GetAttribute(_OF_MESH).Get() or ())
    targets = mesh.GetRelationship(_TARGETS)
    paths, count = list(targets.GetTargets()), len(mesh.GetAttribute("points").Get() or ())
    sums = np.zeros((2, count, 3))
    pairs = [pair for pair in zip(tokens, paths, strict=False) if pair[0] in changed]
    for token, path in pairs:
        shape = UsdSkel.BlendShape(mesh.GetStage().GetPrimAtPath(path))
        a, b = changed[token]
        for row, attribute in enumerate([shape.GetOffsetsAttr(), shape.GetNormalOffsetsAttr()]):
            offsets = np.array(attribute.Get() or (), dtype=np.float64).reshape(-1, 3)
            at = np.array(shape.GetPointIndicesAttr().Get() or (), dtype=int)
            at = at if len(at) else np.arange(len(offsets))
            if not len(offsets) or at.max() >= count:
                continue
            offsets = offsets * _mask(ours[token], count, path)[at]
            sums[row][at] += a * offsets
            attribute.Set(Vt.Vec3fArray.FromNumpy(((b - a) * offsets).astype(np.float32)))
    if pairs:
        path = mesh.GetPath().AppendChild(_standing())
        standing_shape = UsdSkel.BlendShape.Define(mesh.GetStage(), path)
        both = zip(
            (standing_shape.CreateOffsetsAttr(), standing_shape.CreateNormalOffsetsAttr()),
            sums,
            strict=True,
        )
        for attribute, total in both:
            attribute.Set([Gf.Vec3f(*map(float, row)) for row in total])
        standing_shape.CreatePointIndicesAttr().Set(list(range(count)))
        mesh.GetAttribute(_OF_MESH).Set([*tokens, _standing()])
        targets.SetTargets([*paths, path])
    return bool(pairs)


def _mask(blocks: list[tuple], count: int, path) -> np.ndarray:
    """How strongly a key acts on each vertex, `[V, 1]`, since USD keys have no vertex groups."""
    from pxr import Tf

    of_mesh = [pair for pair in blocks if len(pair[0].data.vertices) == count]
    names = set(str(path).split("/"))
    named = [pair for pair in of_mesh if Tf.MakeValidIdentifier(pair[0].name) in names]
    for ob, block in named or of_mesh:
        return emotion_mask.weights(ob, block.vertex_group).astype(np.float64)
    return np.ones((count, 1))


def _hook():
    """The class that Blender calls, or None if Python cannot use Blender's USD."""
    if not hasattr(bpy.types, "USDHook"):
        return None
    # Blender as a Python module exposes its USD only on request.
    if getattr(bpy.app, "module", False) and hasattr(bpy.utils, "expose_bundled_modules"):
        bpy.utils.expose_bundled_modules()
    # Without `pxr` Blender would crash at the first export.
    if importlib.util.find_spec("pxr") is None:
        return None

    class ANYFACE_HOOK_usd(bpy.types.USDHook):
        """Rewrites what is exported."""

        bl_idname = "ANYFACE_HOOK_usd"
        bl_label = "Anyface"

        @staticmethod
        def on_export(export_context):
            """Rewrites the weights before the file is saved."""
            rewrite(export_context.get_stage())
            return True

    return ANYFACE_HOOK_usd


_registered = []


def register() -> None:
    """Registers the hook for exports to USD."""
    hook = _hook()
    if hook is not None:
        bpy.utils.register_class(hook)
        _registered.append(hook)


def unregister() -> None:
    """Removes the hook."""
    while _registered:
        bpy.utils.unregister_class(_registered.pop())
