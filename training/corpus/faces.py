"""The two faces with known motion: ICT FaceKit and the MakeHuman head.

Both come in the canonical frame in metres (+x subject's left, +y up, +z out of the face) with the
same 51 ARKit channels, so that one weight vector drives either.

Shapes: `V` vertices, `F` triangles, `M` channels, `N` = 68 landmarks.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from safetensors import safe_open

from training.align import canonical_landmarks, similarity, stability

CHANNELS = [
    "browDownLeft", "browDownRight", "browInnerUp", "browOuterUpLeft", "browOuterUpRight",
    "cheekPuff", "cheekSquintLeft", "cheekSquintRight", "eyeBlinkLeft", "eyeBlinkRight",
    "eyeLookDownLeft", "eyeLookDownRight", "eyeLookInLeft", "eyeLookInRight", "eyeLookOutLeft",
    "eyeLookOutRight", "eyeLookUpLeft", "eyeLookUpRight", "eyeSquintLeft", "eyeSquintRight",
    "eyeWideLeft", "eyeWideRight", "jawForward", "jawLeft", "jawOpen", "jawRight", "mouthClose",
    "mouthDimpleLeft", "mouthDimpleRight", "mouthFrownLeft", "mouthFrownRight", "mouthFunnel",
    "mouthLeft", "mouthLowerDownLeft", "mouthLowerDownRight", "mouthPressLeft", "mouthPressRight",
    "mouthPucker", "mouthRight", "mouthRollLower", "mouthRollUpper", "mouthShrugLower",
    "mouthShrugUpper", "mouthSmileLeft", "mouthSmileRight", "mouthStretchLeft",
    "mouthStretchRight", "mouthUpperUpLeft", "mouthUpperUpRight", "noseSneerLeft", "noseSneerRight",
]  # fmt: skip
"""All of ARKit's channels but tongueOut, which neither of the two faces can show."""


@dataclass(frozen=True)
class Face:
    """A neutral face and its motion at each channel.

    vertices: [V, 3] m. triangles: [F, 3]. landmarks: [N] vertex numbers.
    modes: [M, V, 3] m, displacement at channel weight 1.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray
    modes: np.ndarray


@dataclass(frozen=True)
class IctModel:
    """The ICT face region (skin without sockets and neck) and its identity modes, canonical metres.

    identity: [100, V, 3], displacement at coefficient 1; coefficients ~ N(0, 1).
    """

    mean: Face
    identity: np.ndarray

    def person(self, coefficients: np.ndarray, name: str = "ict") -> Face:
        """The face of `coefficients` [100], aligned to the canonical frame."""
        vertices = self.mean.vertices + np.tensordot(coefficients, self.identity, 1)
        return align(replace(self.mean, name=name, vertices=vertices))


def align(face: Face) -> Face:
    """Moves a face to the canonical frame by a similarity that weights steady landmarks most."""
    fit = similarity(face.vertices[face.landmarks], canonical_landmarks(), stability())
    return replace(face, vertices=fit(face.vertices), modes=fit.scale * face.modes @ fit.rotation.T)


def load_ict(data: Path, region: str = "face") -> IctModel:
    """ICT FaceKit. `region`: "face" (9,409 vertices) or "skin" (14,062, with neck and sockets)."""
    with safe_open(data / "faces/ict_facekit.safetensors", "np") as f:
        metadata = f.metadata()
        names = json.loads(metadata["expression_names"])
        last = {"face": 9408, "skin": 14061}[region]
        keep = np.arange(last + 1)
        neutral, triangles = f.get_tensor("neutral"), f.get_tensor("triangles")
        landmarks = f.get_tensor("landmarks68").astype(np.int64)
        expression = f.get_tensor("expression")[:, keep].astype(np.float64)
        identity = f.get_tensor("identity")[:, keep].astype(np.float64)
    triangles = triangles[(triangles <= last).all(1)].astype(np.int64)
    by_name = dict(zip(names, expression, strict=True))
    modes = np.stack([channel_of_ict(by_name, c) for c in CHANNELS])
    mean = Face("ict", 0.01 * neutral[keep].astype(np.float64), triangles, landmarks, 0.01 * modes)
    aligned = align(mean)
    scale = np.linalg.norm(aligned.modes) / np.linalg.norm(mean.modes)
    return IctModel(aligned, 0.01 * scale * identity)


def load_makehuman(data: Path) -> Face:
    """The MakeHuman head (decimetres in the file), aligned to the canonical frame."""
    with safe_open(data / "faces/makehuman_head.safetensors", "np") as f:
        names = json.loads(f.metadata()["names"])
        deltas = f.get_tensor("deltas").astype(np.float64)
        face = Face(
            "makehuman",
            0.1 * f.get_tensor("neutral").astype(np.float64),
            f.get_tensor("triangles").astype(np.int64),
            f.get_tensor("landmarks68").astype(np.int64),
            0.1 * deltas[[names.index(c) for c in CHANNELS]],
        )
    return align(face)


def channel_of_ict(modes: dict[str, np.ndarray], channel: str) -> np.ndarray:
    """The ICT mode, or pair of modes, of one ARKit channel. [V, 3]."""
    name = channel if channel in modes else channel.replace("Left", "_L").replace("Right", "_R")
    return modes[name] if name in modes else modes[f"{name}_L"] + modes[f"{name}_R"]
