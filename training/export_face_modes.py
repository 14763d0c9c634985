"""Writes ICT FaceKit's expression modes at the landmarks as the model that `rust-core/src/motion` reads.

    python -m training.export_face_modes --data ../shared/data --models weights/shared

`face_modes/` gets `modes` [M, 68, 3] f32, canonical metres, and a config.json with the modes' names. The
model card, README.md, is written by hand. Nothing is trained here.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from training.corpus.ict import IctLandmarks


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--models", type=Path, default=Path("weights/shared"))
    args = parser.parse_args()
    ict = IctLandmarks(args.data)
    names = list(ict.modes)
    config = {"name": "face_modes", "modes": names}
    folder = args.models / "face_modes"
    folder.mkdir(parents=True, exist_ok=True)
    modes = np.stack([ict.modes[name] for name in names]).astype(np.float32)
    save_file({"modes": modes}, folder / "model.safetensors")
    (folder / "model.safetensors").chmod(0o644)
    (folder / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    print(f"{folder}: {len(names)} modes, {modes.nbytes} bytes")


if __name__ == "__main__":
    main()
