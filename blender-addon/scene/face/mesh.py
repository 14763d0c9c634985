"""Reads the face: the Basis of a mesh object, its triangles, its landmarks."""

import os

import bpy
import numpy as np

from ...core import json_file
from ...core.errors import AnyfaceError
from ...core.take import FaceMesh
from . import emotion_mask, rest

LANDMARKS_PROPERTY = "anyface_landmarks"
# No face can be found on fewer vertices, and the search would take half a minute.
_FEWEST = 60
# An object between these sizes may be a human head, with or without its body.
_SMALLEST_M, _LARGEST_M = 0.08, 3.0


def read_face(ob, landmark_file: str = "") -> FaceMesh:
    """The snapshot of `ob`: Basis positions, triangles, world matrix, landmarks.

    It does not use the evaluated mesh: modifiers change vertex numbers, and shape keys act before
    modifiers. In edit mode it includes the edits made so far.
    """
    if ob.mode == "EDIT":
        ob.update_from_editmode()
    mesh = ob.data
    if len(mesh.vertices) == 0:
        raise AnyfaceError("mesh", f"{ob.name}: the mesh has no vertices")
    if len(mesh.polygons) == 0:
        raise AnyfaceError("mesh", f"{ob.name}: the mesh has no faces, only loose points")
    points, vertices = read_landmarks(ob, landmark_file)
    return FaceMesh(
        name=ob.name,
        positions=read_basis(mesh),
        triangles=read_triangles(mesh),
        matrix_world=np.array(ob.matrix_world, dtype=np.float64),
        landmarks=points,
        landmark_vertices=vertices,
        hints=_hints(ob),
    )


def check_face(ob, face: FaceMesh) -> None:
    """Raises `AnyfaceError("mesh")` for a mesh on which no face can be found."""
    has_landmarks = face.landmarks is not None or face.landmark_vertices is not None
    count = len(face.positions)
    if count < _FEWEST and not has_landmarks:
        raise AnyfaceError(
            "mesh", f"{ob.name} has {count} vertices, too few for a face: pick the mesh of the head"
        )
    if _is_half(ob, face.positions):
        raise AnyfaceError(
            "mesh",
            f"{ob.name} is half a face, which its Mirror modifier completes, and keys would open "
            "the seam: apply the modifier first",
            ("apply_mirror",),
        )


def _is_half(ob, positions: np.ndarray) -> bool:
    """Whether positions `[V, 3]` end at the plane of a Mirror modifier."""
    for modifier in ob.modifiers:
        if modifier.type != "MIRROR":
            continue
        plane = modifier.mirror_object
        to_plane = plane.matrix_world.inverted() @ ob.matrix_world if plane else np.eye(4)
        to_plane = np.array(to_plane, dtype=np.float64)
        low, high = box_of(positions @ to_plane[:3, :3].T + to_plane[:3, 3])
        near = 0.02 * (high - low)
        ends = (np.abs(low) <= near) | (np.abs(high) <= near)
        if (ends & np.array(modifier.use_axis)).any():
            return True
    return False


def read_key(block) -> np.ndarray:
    """Positions `[V, 3]` float32 of a shape key."""
    flat = np.empty(len(block.points) * 3, dtype=np.float32)
    block.points.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def read_pose(ob) -> np.ndarray:
    """How far the shape keys of `ob` move its vertices now, `[V, 3]` float32.

    Raises `AnyfaceError("mesh")` for absolute shape keys.
    """
    moved = np.zeros_like(read_basis(ob.data))
    keys = ob.data.shape_keys
    if keys is None:
        return moved
    if not keys.use_relative:
        raise AnyfaceError(
            "mesh",
            f"{ob.name}: Start from Current Pose reads relative shape keys, not absolute ones",
        )
    for block in keys.key_blocks[1:]:
        if block.value and not block.mute:
            reach = block.value * emotion_mask.weights(ob, block.vertex_group)
            moved += reach * (read_key(block) - read_key(block.relative_key))
    return moved


def add_key(ob, name: str, positions: np.ndarray):
    """A new shape key of `positions` `[V, 3]` at value 0."""
    block = ob.shape_key_add(name=name, from_mix=False)
    # From 5.0 on a new key has the value 1.
    block.value = 0.0
    block.points.foreach_set("co", np.ascontiguousarray(positions, dtype=np.float32).ravel())
    return block


def is_of_human_size(ob) -> bool:
    """Whether `ob` in the world is as large as a human head or body, or a part of one."""
    points = np.array(ob.bound_box) @ np.array(ob.matrix_world)[:3, :3].T
    metres = np.ptp(points, axis=0).max() * bpy.context.scene.unit_settings.scale_length
    return _SMALLEST_M <= metres <= _LARGEST_M


def read_basis(mesh) -> np.ndarray:
    """Positions `[V, 3]` float32 of the Basis key, or of the mesh where it has no keys."""
    if mesh.shape_keys is not None:
        return read_key(mesh.shape_keys.reference_key)
    flat = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    if "position" in mesh.attributes:
        mesh.attributes["position"].data.foreach_get("vector", flat)
    else:
        # Attributes are hidden in edit mode.
        mesh.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def box_of(positions: np.ndarray) -> np.ndarray:
    """Lowest and highest coordinates `[2, 3]` of positions `[V, 3]`."""
    return np.stack([positions.min(axis=0), positions.max(axis=0)]).astype(np.float64)


def read_triangles(mesh) -> np.ndarray:
    """Triangles `[F, 3]` uint32 of all polygons."""
    mesh.calc_loop_triangles()
    flat = np.empty(len(mesh.loop_triangles) * 3, dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", flat)
    return flat.reshape(-1, 3).astype(np.uint32)


def read_landmarks(ob, path: str = "") -> tuple[np.ndarray | None, np.ndarray | None]:
    """The artist's landmarks: positions `[68, 3]` in object space, vertices `[68]`, or both.

    `path` names a JSON file. Without it, they come from the custom property `anyface_landmarks` of
    the object or its mesh, which holds JSON or the path of a JSON file. The JSON holds 68
    positions, 68 vertex numbers, `{"positions": …}`, `{"vertices": …}`, or the output of
    `anyface landmarks`.
    """
    value = path or ob.get(LANDMARKS_PROPERTY, ob.data.get(LANDMARKS_PROPERTY))
    if value is None or value == "":
        return None, None
    if isinstance(value, str):
        value = _load(value, ob)
    elif hasattr(value, "to_list"):
        value = value.to_list()
    if isinstance(value, dict) and "landmarks" in value:
        return _from_file(value["landmarks"], ob, value.get("box"))
    return _as_landmarks(value)


def _load(text: str, ob):
    if text.lstrip()[:1] not in ("[", "{"):
        path = bpy.path.abspath(text, library=ob.library)
        if os.path.exists(path) and not os.path.isfile(path):
            raise AnyfaceError("file", f"{path}: expected a file of landmarks, got no file")
        return json_file.read(path)
    try:
        return json_file.parse(text)
    except ValueError as error:
        raise AnyfaceError("input", f"{LANDMARKS_PROPERTY}: not JSON: {error}") from error


def _from_file(rows, ob, box=None):
    """Positions with vertex numbers from the rows of a landmark file, or the numbers alone.

    The file has the axes and units of the mesh that was measured. An importer may have turned or
    scaled the mesh since then. Vertex numbers stay valid all the same. Positions are valid if the
    mesh still fills the `box` in which it was measured, however coarse it is. Vertex numbers come
    along with positions because they tell apart the rims of lips that touch.
    """
    try:
        rows = sorted(rows, key=lambda row: row["index"])
        positions = np.array([row["position"] for row in rows], dtype=np.float64)
        vertices = np.array([row["vertex"] for row in rows], dtype=np.uint32)
    except (TypeError, KeyError, ValueError, OverflowError) as error:
        raise AnyfaceError("input", f"{LANDMARKS_PROPERTY}: not a landmark file: {error}") from None
    if len(vertices) != 68:
        return _as_landmarks(positions)
    basis = read_basis(ob.data)
    if positions.shape != (68, 3):
        return _as_landmarks(positions)
    if _is_box(box):
        near = 1e-3 * np.ptp(basis, axis=0).max()
        if np.abs(box_of(basis) - np.array(box)).max() <= near:
            return _as_landmarks(positions)[0], vertices
    if vertices.max() >= len(basis):
        return _as_landmarks(positions)
    size = np.ptp(positions, axis=0).max()
    apart = np.linalg.norm(basis[vertices] - positions, axis=1).max()
    points, _ = _as_landmarks(positions)
    return (points if apart < 0.05 * size else None), vertices


def _is_box(box) -> bool:
    """Whether a value of a text is two corners."""
    rows = box if isinstance(box, list) and len(box) == 2 else []
    numbers = [one for row in rows if isinstance(row, list) and len(row) == 3 for one in row]
    return len(numbers) == 6 and all(isinstance(one, int | float) for one in numbers)


def _as_landmarks(value) -> tuple[np.ndarray | None, np.ndarray | None]:
    if isinstance(value, dict):
        value = value.get("vertices", value.get("positions"))
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape == (204,):
        array = array.reshape(68, 3)
    if array.shape == (68, 3) and np.isfinite(array).all():
        return array, None
    if array.shape == (68,) and (array >= 0).all():
        return None, array.astype(np.uint32)
    raise AnyfaceError(
        "input",
        f"{LANDMARKS_PROPERTY}: expected 68 positions [68, 3] or 68 vertex numbers, "
        f"got an array of shape {list(array.shape)}",
    )


def _hints(ob) -> list[str]:
    """Possible reasons why no face is found."""
    hints = []
    if any(modifier.type == "MIRROR" for modifier in ob.modifiers):
        hints.append("Half of the face comes from a Mirror modifier: apply it")
    around = _around(ob)
    if around:
        hints.append(f"{around} lies around it: pick that mesh if it is the face")
    return hints


def _around(ob) -> str:
    """The name of the smallest mesh near `ob` whose box encloses the box of `ob`, or ""."""
    low, high = box_of(corners(ob))
    sizes = {}
    for other in {other for collection in ob.users_collection for other in collection.objects}:
        if other.type != "MESH" or other == ob or not len(other.data.polygons):
            continue
        corner, opposite = box_of(corners(other))
        if (corner <= low).all() and (high <= opposite).all():
            sizes[other.name] = float(np.prod(opposite - corner))
    return min(sizes, key=sizes.get, default="")


def corners(ob) -> np.ndarray:
    """The corners `[8, 3]` of an object's box in the world, with armatures in rest pose."""
    matrix, points = rest.world(ob), np.array(ob.bound_box, dtype=np.float64)
    if any(modifier.type == "ARMATURE" for modifier in ob.modifiers):
        # The object's own box encloses the posed mesh.
        low_high = box_of(read_basis(ob.data))
        points = np.stack([low_high[list(pick), range(3)] for pick in np.ndindex(2, 2, 2)])
    return points @ matrix[:3, :3].T + matrix[:3, 3]
