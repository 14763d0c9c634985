"""A minimal VRM 1.0 avatar with a face.

It has bones, a ball for a head, and a mouth and two eyes that VRM's expressions move.
"""

import json
import struct
from pathlib import Path

import numpy as np

_BONES = {
    "hips": (None, 1.0),
    "spine": ("hips", 0.2),
    "head": ("spine", 0.4),
    **{
        f"{side}{part}": (f"{side}{parent}" if parent else root, -0.2)
        for side in ("left", "right")
        for part, parent, root in (
            ("UpperLeg", "", "hips"),
            ("LowerLeg", "UpperLeg", ""),
            ("Foot", "LowerLeg", ""),
            ("UpperArm", "", "spine"),
            ("LowerArm", "UpperArm", ""),
            ("Hand", "LowerArm", ""),
        )
    },
}
# Width and height of the mouth, and height of the left and the right eye, all in metres.
_REST = (0.05, 0.004, 0.02, 0.02)
_EXPRESSIONS = {
    "aa": (0.05, 0.05, 0.02, 0.02),
    "ih": (0.06, 0.015, 0.02, 0.02),
    "ou": (0.02, 0.02, 0.02, 0.02),
    "ee": (0.07, 0.02, 0.02, 0.02),
    "oh": (0.035, 0.04, 0.02, 0.02),
    "blinkLeft": (0.05, 0.004, 0.001, 0.02),
    "blinkRight": (0.05, 0.004, 0.02, 0.001),
}


def _ellipse(x: float, y: float, width: float, height: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, 25)[:-1]
    rim = np.stack(
        [x + width / 2 * np.cos(angle), y + height / 2 * np.sin(angle), 0 * angle + 0.115], 1
    )
    return np.vstack([[[x, y, 0.115]], rim])


def _features(width: float, mouth: float, left: float, right: float) -> np.ndarray:
    parts = [(0, -0.045, width, mouth), (0.04, 0.03, 0.03, left), (-0.04, 0.03, 0.03, right)]
    return np.vstack([_ellipse(*part) for part in parts]).astype("<f4")


def _fans() -> np.ndarray:
    fan = [(25 * k, 25 * k + 1 + i, 25 * k + 1 + (i + 1) % 24) for k in range(3) for i in range(24)]
    return np.array(fan, "<u2")


def _ball() -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.meshgrid(
        np.linspace(0, np.pi, 17), np.linspace(0, 2 * np.pi, 33), indexing="ij"
    )
    round_ = np.stack(
        [np.sin(rows) * np.cos(columns), np.cos(rows), np.sin(rows) * np.sin(columns)], -1
    )
    quads = [
        (33 * r + c, 33 * r + c + 1, 33 * r + c + 33, 33 * r + c + 34)
        for r in range(16)
        for c in range(32)
    ]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (b, d, c))]
    return (0.11 * round_.reshape(-1, 3)).astype("<f4"), np.array(triangles, "<u2")


class _Glb:
    def __init__(self):
        self.bytes, self.views, self.accessors = b"", [], []

    def add(self, array: np.ndarray) -> int:
        """Adds points `[V, 3]` or triangles `[T, 3]`; returns the number of their accessor."""
        is_points = array.dtype == "<f4"
        self.views.append({"buffer": 0, "byteOffset": len(self.bytes), "byteLength": array.nbytes})
        self.bytes += array.tobytes() + b"\0" * (-array.nbytes % 4)
        bounds = {"min": array.min(0).tolist(), "max": array.max(0).tolist()} if is_points else {}
        count = len(array) if is_points else array.size
        kind = (
            {"componentType": 5126, "type": "VEC3"}
            if is_points
            else {"componentType": 5123, "type": "SCALAR"}
        )
        self.accessors.append({"bufferView": len(self.views) - 1, "count": count, **kind, **bounds})
        return len(self.accessors) - 1


def _bind(node: int, number: int) -> dict:
    return {"morphTargetBinds": [{"node": node, "index": number, "weight": 1.0}]}


def _colour(rgb: tuple) -> dict:
    metal = {"baseColorFactor": [*rgb, 1], "metallicFactor": 0}
    return {"doubleSided": True, "pbrMetallicRoughness": metal}


def write(path: Path) -> None:
    """Writes the avatar."""
    glb, names = _Glb(), list(_BONES)
    nodes = [
        {
            "name": name,
            "translation": [0, up, 0],
            "children": [names.index(n) for n in names if _BONES[n][0] == name],
        }
        for name, (_, up) in _BONES.items()
    ]
    for node in nodes:
        if not node["children"]:
            del node["children"]
    ball, triangles = _ball()
    rest = _features(*_REST)
    targets = [{"POSITION": glb.add(_features(*moved) - rest)} for moved in _EXPRESSIONS.values()]
    skin = {
        "attributes": {"POSITION": glb.add(ball), "NORMAL": glb.add(ball / np.float32(0.11))},
        "indices": glb.add(triangles),
        "material": 0,
    }
    face = {
        "attributes": {"POSITION": glb.add(rest)},
        "indices": glb.add(_fans()),
        "material": 1,
        "targets": targets,
    }
    nodes[names.index("head")]["children"] = [len(nodes), len(nodes) + 1]
    nodes += [{"name": "Skin", "mesh": 0}, {"name": "Face", "mesh": 1}]
    face_node = len(nodes) - 1
    vrm = {
        "specVersion": "1.0",
        "meta": {
            "name": "Ball",
            "authors": ["Anyface"],
            "licenseUrl": "https://vrm.dev/licenses/1.0/",
        },
        "humanoid": {"humanBones": {name: {"node": number} for number, name in enumerate(names)}},
        "expressions": {
            "preset": {name: _bind(face_node, number) for number, name in enumerate(_EXPRESSIONS)}
        },
    }
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"primitives": [skin]}, {"primitives": [face]}],
        "materials": [_colour((0.9, 0.7, 0.55)), _colour((0.1, 0.02, 0.02))],
        "accessors": glb.accessors,
        "bufferViews": glb.views,
        "buffers": [{"byteLength": len(glb.bytes)}],
        "extensionsUsed": ["VRMC_vrm"],
        "extensions": {"VRMC_vrm": vrm},
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(glb.bytes)
    parts = [
        struct.pack("<III", 0x46546C67, 2, size),
        struct.pack("<II", len(text), 0x4E4F534A),
        text,
    ]
    path.write_bytes(b"".join([*parts, struct.pack("<II", len(glb.bytes), 0x004E4942), glb.bytes]))
