"""Digests of a mesh and an action. They show whether anyone has changed a copy of ours."""

import hashlib

import numpy as np

from ..face.mesh import read_key
from . import curves

# For each type of attribute: the name of its value, how many numbers it has, and their type.
_VALUES = {
    "FLOAT": ("value", 1, np.float32),
    "INT": ("value", 1, np.int32),
    "BOOLEAN": ("value", 1, np.bool_),
    "FLOAT2": ("vector", 2, np.float32),
    "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color", 4, np.float32),
}


def action_digest(action) -> str:
    """A digest of every curve of an action."""
    digest = hashlib.blake2b(digest_size=12)
    fcurves = [curve for bag in curves.bags(action) for curve in bag.fcurves]
    for curve in sorted(fcurves, key=lambda curve: (curve.data_path, curve.array_index)):
        keys = curves.places(curve).tobytes()
        digest.update(f"{curve.data_path}[{curve.array_index}]".encode() + keys)
    return digest.hexdigest()


def mesh_digest(mesh) -> str:
    """A digest of corners, attributes, vertex weights, materials and shape keys of a mesh."""
    digest = hashlib.blake2b(digest_size=12)
    corners = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    digest.update(corners.tobytes())
    for attribute in mesh.attributes:
        digest.update(attribute.name.encode() + _attribute_bytes(attribute))
    weights = [(group.group, group.weight) for v in mesh.vertices for group in v.groups]
    digest.update(np.array(weights, dtype=np.float32).tobytes())
    digest.update("\n".join(slot.name if slot else "" for slot in mesh.materials).encode())
    if mesh.shape_keys is not None:
        _add_keys(digest, mesh.shape_keys)
    return digest.hexdigest()


def _attribute_bytes(attribute) -> bytes:
    if attribute.data_type not in _VALUES:
        return b""
    name, width, kind = _VALUES[attribute.data_type]
    values = np.empty(len(attribute.data) * width, dtype=kind)
    attribute.data.foreach_get(name, values)
    return values.tobytes()


def _add_keys(digest, shape_keys) -> None:
    # Curves and drivers change the values with the frame, so such values say nothing.
    unanimated = shape_keys.animation_data is None
    for block in shape_keys.key_blocks:
        positions = read_key(block)
        value = f"{block.value:.6f}" if unanimated else ""
        digest.update(f"{block.name}:{value}".encode() + positions.tobytes())
