"""Export for other programs: each of Blender's exporters, with the switches that a take needs."""

from dataclasses import dataclass

import bpy

from ..core.errors import AnyfaceError
from . import identity, outputs


@dataclass(frozen=True)
class Kind:
    """A file format: its ending, and the exporter's operator, add-on and arguments but the path."""

    label: str
    help: str
    ending: str
    operator: str
    module: str
    selection: str
    switches: dict


KINDS = {
    "GLTF": Kind(
        "glTF",
        "For Godot, three.js, Unreal and the web; one animation of the scene's frames",
        ".glb",
        "export_scene.gltf",
        "io_scene_gltf2",
        "use_selection",
        {
            "export_format": "GLB",
            "export_animations": True,
            "export_animation_mode": "SCENE",
            "export_anim_scene_split_object": False,
            "export_morph": True,
            "export_morph_animation": True,
            "export_force_sampling": True,
            # Frames before 0 are cropped; otherwise everything would be shifted.
            "export_negative_frame": "CROP",
        },
    ),
    "FBX": Kind(
        "FBX",
        "For Unity, Unreal and Maya; weights below 0 stay, which some engines clamp",
        ".fbx",
        "export_scene.fbx",
        "io_scene_fbx",
        "use_selection",
        # If either of the first two is on, the exporter leaves out the animation of shape keys.
        {
            "bake_anim_use_nla_strips": False,
            "bake_anim_use_all_actions": False,
            "bake_anim": True,
            "bake_anim_simplify_factor": 0.0,
        },
    ),
    "USD": Kind(
        "USD",
        "For Houdini, Maya, Omniverse and Unreal; blend shapes, or points of a cache",
        ".usdc",
        "wm.usd_export",
        "",
        "selected_objects_only",
        {"export_animation": True, "export_shapekeys": True},
    ),
    "ABC": Kind(
        "Alembic",
        "For every program that reads point caches: the shape of every frame, without keys",
        ".abc",
        "wm.alembic_export",
        "",
        "selected",
        {"as_background_job": False},
    ),
}


def is_there(kind: Kind) -> bool:
    """Whether this Blender has the exporter, with its add-on enabled."""
    group, name = kind.operator.split(".")
    return name in dir(getattr(bpy.ops, group))


def write(ob, kind: Kind, path: str, whole_scene: bool) -> None:
    """Exports `ob` and the objects of its face, or the whole scene; the selection stays.

    Raises `AnyfaceError`.
    """
    if not is_there(kind):
        on = f": turn the add-on {kind.module} on" if kind.module else ""
        raise AnyfaceError("input", f"this Blender has no exporter for {kind.label}{on}")
    output = outputs.of_object(ob)
    if output is not None and kind.label in output.lost_in:
        raise AnyfaceError("input", output.lost_in[kind.label])
    group, name = kind.operator.split(".")
    call = getattr(getattr(bpy.ops, group), name)
    known = call.get_rna_type().properties.keys()
    switches = {key: value for key, value in kind.switches.items() if key in known}
    layer = bpy.context.view_layer
    selected = [one for one in layer.objects if one.select_get(view_layer=layer)]
    try:
        if not whole_scene:
            _select(layer, _of_face(ob))
        call(filepath=path, **switches, **{kind.selection: not whole_scene})
    except RuntimeError as error:
        raise AnyfaceError("file", f"{kind.label}: {str(error).strip()}") from error
    finally:
        _select(layer, selected)


def _of_face(ob) -> list:
    """The face, the objects that belong to it, and the rigs and parents of all of these."""
    objects = [ob, *identity.parts_of(ob)]
    for one in objects:
        rigs = [m.object for m in one.modifiers if m.type == "ARMATURE" and m.object is not None]
        objects += [more for more in {*rigs, one.parent} - {None} if more not in objects]
    return objects


def _select(layer, objects: list) -> None:
    for one in layer.objects:
        is_chosen = one in objects
        if one.select_get(view_layer=layer) != is_chosen:
            one.select_set(is_chosen, view_layer=layer)
