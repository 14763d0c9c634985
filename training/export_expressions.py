"""Writes the table of expressions as the model that `rust-core/src/motion/expression` reads.

    python -m training.export_expressions --data ../shared/data --models weights/shared

`expressions/` gets `lasting` and `opening`, [15, 68, 3] f32 each: what an emotion at intensity 1 adds to
the landmarks in canonical metres (`training/corpus/emotions.py`), and a config.json with how it changes
articulation and how fast it comes and goes (`training/corpus/manner.py`). The model card, README.md, is
written by hand. Nothing is trained here.
"""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from safetensors.numpy import save_file

from training.corpus.conditions import EMOTIONS
from training.corpus.emotions import expressions
from training.corpus.manner import MANNERS, OFFSET_OVER_ONSET


def config() -> dict:
    """As written to config.json."""
    manners = {emotion: asdict(MANNERS[emotion]) for emotion in EMOTIONS}
    return {"name": "expressions", "emotions": manners, "offset_over_onset": OFFSET_OVER_ONSET}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--models", type=Path, default=Path("weights/shared"))
    args = parser.parse_args()
    lasting, opening = expressions(args.data)
    folder = args.models / "expressions"
    folder.mkdir(parents=True, exist_ok=True)
    save_file({"lasting": lasting, "opening": opening}, folder / "model.safetensors")
    (folder / "model.safetensors").chmod(0o644)
    (folder / "config.json").write_text(json.dumps(config(), indent=1) + "\n")
    print(f"{folder}: {len(lasting)} expressions, {lasting.nbytes + opening.nbytes} bytes")


if __name__ == "__main__":
    main()
