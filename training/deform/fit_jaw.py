"""Fits the motion of the lower jaw to that of the face's contour landmarks, for `deform/jaw.rs`.

    python -m training.deform.fit_jaw --data ../shared/data

The truth is ICT FaceKit's lower teeth, which move rigidly: pitch and yaw about the hinge and a slide.
Those five numbers are regressed on the displacements of landmarks 2 to 14, with a ridge, on the
training takes of facegood_zh with random expressions. Each frame counts together with its mirror image.
The result is written to rust-core/src/deform/jaw_from_contour.json, with lengths in canonical centimetres.
"""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from training import DATA, REPOSITORY
from training.align import canonical_landmarks, similarity
from training.corpus.expressions import load_speech, training_frames
from training.corpus.faces import CHANNELS
from training.deform.evaluate_parts import GAZE, load_head
from training.flags import run_command

CONTOUR = list(range(2, 15))
RIDGE = 0.01
"""Ridge of the regression, as a share of the landmarks' mean power.

A ridge ten times smaller or larger changes the teeth by less than 0.1 mm.
"""
TARGET = REPOSITORY / "rust-core/src/deform/jaw_from_contour.json"


def hinge_of(teeth: np.ndarray, opening: np.ndarray) -> np.ndarray:
    """The point [3] of the middle plane about which displacements [V, 3] turn the teeth [V, 3]."""
    fit = similarity(teeth, teeth + opening)
    turned, shift = fit.rotation - np.eye(3), fit.goal - fit.rotation @ fit.centre
    y, z = np.linalg.lstsq(turned[1:, 1:], -shift[1:], rcond=None)[0]
    return np.array([0.0, y, z])


def poses(teeth: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Pitch, yaw (radians) and slide x, y, z of every frame [T, 5]. `teeth` are relative to the hinge."""
    out = []
    for frame in motion:
        fit = similarity(teeth, teeth + frame)
        turn = Rotation.from_matrix(fit.rotation).as_rotvec()
        out.append([turn[0], turn[1], *(fit.goal - fit.rotation @ fit.centre)])
    return np.array(out)


def regressed(landmarks: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The map `[5, 39]` from contour displacements [T, 13, 3] to pose [T, 5]."""
    mirrored = landmarks[:, ::-1] * [-1.0, 1.0, 1.0]
    x = np.concatenate([landmarks, mirrored]).reshape(2 * len(pose), -1)
    y = np.concatenate([pose, pose * [1.0, -1.0, -1.0, 1.0, 1.0]])
    power = x.T @ x
    damped = power + RIDGE * np.trace(power) / len(power) * np.eye(len(power))
    return np.linalg.solve(damped, x.T @ y).T


def main(data: Path = DATA) -> None:
    """Entry of the command."""
    head = load_head(data)
    # ICT differs from the canonical frame only in its origin.
    offset = 100.0 * canonical_landmarks().mean(0) - head.neutral[head.landmarks].mean(0)
    teeth = head.parts["teeth, lower"]
    opening = head.modes[CHANNELS.index("jawOpen"), teeth]
    hinge = hinge_of(head.neutral[teeth] + offset, opening)
    weights = training_frames(np.random.default_rng(3), load_speech(data).train, 4000)
    weights[:, GAZE] = 0.0
    contour = head.landmarks[CONTOUR]
    moved = np.einsum("tm,mvx->tvx", weights, head.modes[:, contour])
    truth = np.einsum("tm,mvx->tvx", weights, head.modes[:, teeth])
    pose = regressed(moved, poses(head.neutral[teeth] + offset - hinge, truth))
    landmarks = head.neutral[head.landmarks] + offset
    middle, chin = (landmarks[2] + landmarks[14]) / 2, landmarks[8]
    along, back = (chin - middle)[1:], hinge[1:] - middle[1:]
    across = np.array([along[1], -along[0]])
    power = along @ along
    result = {
        "landmarks": CONTOUR,
        "hinge": [round(float(back @ v / power), 4) for v in (along, across)],
        "lever_cm": round(float(np.linalg.norm(chin - hinge)), 3),
        "pose": [[round(float(x), 4) + 0.0 for x in row] for row in pose],
    }
    TARGET.write_text(json.dumps(result).replace("], [", "],\n  [").replace(', "', ',\n  "') + "\n")


if __name__ == "__main__":
    run_command(main)
