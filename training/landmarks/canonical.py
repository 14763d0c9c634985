"""The canonical face frame and its mean landmarks, taken from the mean ICT identity.

Canonical frame: metres, +x to the subject's left, +y up, +z out of the face, origin between the
jaw hinges. ICT FaceKit has no bones, so its own contour landmarks place the hinges: at the mean
of landmarks 0, 1, 15 and 16, which lie in front of the ears at the height of the joint.

    python -m training.landmarks.canonical --data ../shared/data

writes `rust-core/src/mesh/canonical_landmarks.json`, read by both sides.
"""

import json
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from training import DATA
from training.align import CANONICAL
from training.flags import run_command

HINGES = [0, 1, 15, 16]


def from_ict(points_cm: np.ndarray) -> np.ndarray:
    """Points of the ICT model, `[..., 3]` in its own centimetres, to canonical metres."""
    return (points_cm - _origin_cm()) * 0.01


def _origin_cm() -> np.ndarray:
    return np.array(json.loads(CANONICAL.read_text())["ict_origin_cm"])


def main(data: Path = DATA) -> None:
    """Writes the json file."""
    ict = load_file(data / "faces/ict_facekit.safetensors")
    landmarks_cm = ict["neutral"][ict["landmarks68"]].astype(np.float64)
    origin_cm = landmarks_cm[HINGES].mean(axis=0)
    origin_cm[0] = 0.0
    document = {
        "source": "USC ICT FaceKit (MIT), mean identity, neutral; iBUG-68 order",
        "frame": "metres, +x subject's left, +y up, +z out of the face, origin between the jaw hinges",
        "ict_origin_cm": [round(float(x), 6) for x in origin_cm],
        "landmarks": [[round(float(x), 6) for x in p] for p in (landmarks_cm - origin_cm) * 0.01],
    }
    lines = [f"  {json.dumps(p)}" for p in document.pop("landmarks")]
    head = json.dumps(document, indent=2).rstrip("}\n")
    CANONICAL.write_text(head + ',\n  "landmarks": [\n' + ",\n".join(lines) + "\n  ]\n}\n")


if __name__ == "__main__":
    run_command(main)
