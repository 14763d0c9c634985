"""Writes ICT FaceKit's expression modes at the landmarks as the model that `rust-core/src/motion` reads.

    python -m training.export_face_modes --data ../shared/data --models rust-core/models

`face_modes/` gets `modes` [M, 68, 3] f32, canonical metres, and a config.json with the modes' names,
the weights of each emotion's prototype (`training/corpus/emotions.py`, in two parts: what lasts
through speech, and what opens the mouth), and how it comes and goes (`training/corpus/manner.py`).
The model card, README.md, is written by hand. Nothing is trained here.
"""

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from training.corpus.clip import FPS
from training.corpus.emotions import AU_TO_ARKIT, OPENING, PROTOTYPES
from training.corpus.ict import IctLandmarks
from training.corpus.manner import MANNERS, OFFSET_OVER_ONSET, ONE_POLE, SETTLING_FRAMES
from training.systems.freetalk.ats import EMOTIONS


def prototype(emotion: str, known: list[str]) -> dict:
    """Weights of ICT's modes for one emotion at intensity 1, `lasting` and `opening`; `rise_s`."""
    parts = {"lasting": Counter(), "opening": Counter()}
    for unit, strength in PROTOTYPES[emotion].items():
        part = parts["opening" if unit in OPENING else "lasting"]
        for shape in AU_TO_ARKIT[unit]:
            # ICT splits what ARKit has as one shape for both sides.
            for name in [shape] if shape in known else [f"{shape}_L", f"{shape}_R"]:
                part[name] += strength
    weights = {key: {name: round(w, 6) for name, w in part.items()} for key, part in parts.items()}
    return weights | {"rise_s": round(MANNERS[emotion].onset_s / ONE_POLE, 6)}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--models", type=Path, default=Path("rust-core/models"))
    args = parser.parse_args()
    ict = IctLandmarks(args.data)
    names = list(ict.modes)
    config = {
        "name": "face_modes",
        "modes": names,
        "emotions": {emotion: prototype(emotion, names) for emotion in EMOTIONS},
        "fall_over_rise": OFFSET_OVER_ONSET,
        "settling_s": SETTLING_FRAMES / FPS,
    }
    folder = args.models / "face_modes"
    folder.mkdir(parents=True, exist_ok=True)
    modes = np.stack([ict.modes[name] for name in names]).astype(np.float32)
    save_file({"modes": modes}, folder / "model.safetensors")
    (folder / "model.safetensors").chmod(0o644)
    (folder / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    print(f"{folder}: {len(names)} modes, {modes.nbytes} bytes")


if __name__ == "__main__":
    main()
