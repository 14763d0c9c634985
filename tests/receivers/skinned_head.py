"""The default head as an avatar.

Its objects are on a skeleton of .01. It has a material, a picture, animations and two targets.
"""

import base64
import json
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np

from conftest import HEAD

HEIGHT_M = 1.6
"""How high the head stands."""
OWN_TARGETS = ("Ear", "mouthSmileLeft")
TIMES_S = (0.0, 0.5, 1.0)
OWN_WEIGHTS = ((0.0, 0.25), (1.0, 0.5), (0.0, 0.0))
_BONES = {"Hips": (None, 0.0), "Neck": ("Hips", 140.0), "Head": ("Neck", 20.0)}
_PICTURE = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg=="
)


def objects() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Places and triangles of each object of the default head, in the order of its file."""
    read, name, first = {}, "", 0
    for line in (HEAD / "head.obj").read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "o":
            first += len(read[name][0]) if name else 0
            name = rest[0]
            read[name] = ([], [])
        elif word == "v":
            read[name][0].append([float(x) for x in rest])
        elif word == "f":
            a, *others = [int(corner.split("/")[0]) - 1 - first for corner in rest]
            read[name][1].extend([a, b, c] for b, c in pairwise(others))
    return {name: (np.array(v, "<f4"), np.array(f, "<u4")) for name, (v, f) in read.items()}


class _Glb:
    def __init__(self):
        self.bytes, self.views, self.accessors = b"", [], []

    def view(self, data: bytes) -> int:
        """Adds bytes; returns the number of their view."""
        self.views.append({"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data)})
        self.bytes += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def add(self, array: np.ndarray, kind: str, has_bounds=False) -> int:
        """Adds an array; returns the number of its accessor."""
        code = {"<f4": 5126, "<u4": 5125, "|u1": 5121}[array.dtype.str]
        bounds = {"min": array.min(0).tolist(), "max": array.max(0).tolist()} if has_bounds else {}
        accessor = {"bufferView": self.view(array.tobytes()), "componentType": code, "type": kind}
        self.accessors.append({**accessor, "count": len(array), **bounds})
        return len(self.accessors) - 1


def write(path: Path) -> None:
    """Writes the avatar."""
    glb, names = _Glb(), list(_BONES)
    nodes = []
    for name, (_, up_cm) in _BONES.items():
        children = [names.index(n) for n in names if _BONES[n][0] == name]
        placed = {"translation": [0, up_cm, 0]} if up_cm else {"scale": [0.01] * 3}
        nodes.append({"name": name, **placed, **({"children": children} if children else {})})
    binds = np.tile(np.diag([100.0, 100.0, 100.0, 1.0]), (3, 1, 1))
    binds[:, 3, 1] = [0.0, -140.0, -160.0]
    skin = {"joints": [0, 1, 2], "skeleton": 0, "inverseBindMatrices": 0}
    glb.add(np.ascontiguousarray(binds, "<f4").reshape(3, 16), "MAT4")
    meshes = []
    for name, (places, triangles) in objects().items():
        places = places + np.float32([0, HEIGHT_M, 0])
        weights = np.zeros((len(places), 4), "<f4")
        share = np.clip((places[:, 1] - HEIGHT_M + 0.12) / 0.05, 0, 1) if name == "skin" else 1.0
        weights[:, 2], weights[:, 1] = share, 1.0 - share
        numbers = np.tile(np.array([0, 1, 2, 0], "|u1"), (len(places), 1))
        numbers[weights == 0] = 0
        attributes = {
            "POSITION": glb.add(places, "VEC3", has_bounds=True),
            "TEXCOORD_0": glb.add(np.ascontiguousarray(places[:, :2]), "VEC2"),
            "JOINTS_0": glb.add(numbers, "VEC4"),
            "WEIGHTS_0": glb.add(weights, "VEC4"),
        }
        corners = glb.add(triangles.reshape(-1), "SCALAR")
        part = {"attributes": attributes, "indices": corners, "material": 0}
        meshes.append({"name": name, "primitives": [part]})
        nodes.append({"name": name, "mesh": len(meshes) - 1, "skin": 0, "extras": {"mine": name}})
    count = len(objects()["skin"][0])
    targets = [np.zeros((count, 3), "<f4") for _ in OWN_TARGETS]
    targets[0][:50, 0] = targets[1][50:100, 2] = 0.01
    meshes[0]["primitives"][0]["targets"] = [
        {"POSITION": glb.add(target, "VEC3", has_bounds=True)} for target in targets
    ]
    meshes[0]["extras"] = {"targetNames": list(OWN_TARGETS), "mine": 1}
    times = glb.add(np.array(TIMES_S, "<f4"), "SCALAR")
    glb.accessors[times].update(min=[TIMES_S[0]], max=[TIMES_S[-1]])
    turns = glb.add(np.array([[0, 0, 0, 1], [0.1, 0, 0, 0.995], [0, 0, 0, 1]], "<f4"), "VEC4")
    own = glb.add(np.array(OWN_WEIGHTS, "<f4").reshape(-1), "SCALAR")
    spline = np.zeros((3, 3, 2), "<f4")
    spline[:, 1] = OWN_WEIGHTS
    splines = glb.add(spline.reshape(-1), "SCALAR")
    face = len(_BONES)

    def animation(name: str, output: int, node: int, path: str, kind: str) -> dict:
        return {
            "name": name,
            "channels": [{"sampler": 0, "target": {"node": node, "path": path}}],
            "samplers": [{"input": times, "output": output, "interpolation": kind}],
        }

    picture = {"bufferView": glb.view(_PICTURE), "mimeType": "image/png"}
    base = {"baseColorFactor": [0.9, 0.7, 0.6, 1], "metallicFactor": 0}
    glow = {"emissiveTexture": {"index": 0}}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, *range(face, len(nodes))]}],
        "nodes": nodes,
        "meshes": meshes,
        "skins": [skin],
        "materials": [{"name": "Skin", "pbrMetallicRoughness": base, **glow}],
        "textures": [{"source": 0}],
        "images": [picture],
        "animations": [
            animation("Nod", turns, 2, "rotation", "LINEAR"),
            animation("Smile", own, face, "weights", "LINEAR"),
            animation("Ease", splines, face, "weights", "CUBICSPLINE"),
        ],
        "extras": {"author": "Ann"},
        "accessors": glb.accessors,
        "bufferViews": glb.views,
        "buffers": [{"byteLength": len(glb.bytes)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    size = 28 + len(text) + len(glb.bytes)
    chunks = [struct.pack("<III", 0x46546C67, 2, size), struct.pack("<II", len(text), 0x4E4F534A)]
    chunks += [text, struct.pack("<II", len(glb.bytes), 0x004E4942), glb.bytes]
    path.write_bytes(b"".join(chunks))
