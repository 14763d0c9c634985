"""Makes the default head: an ICT identity on our own triangulation, with eyes, teeth and tongue.

    python -m training.default_head.make --data ../shared/data --seed 11 \
        --out weights/shared/default_head

writes `head.obj` and `head.mtl` (metres, +x subject's left, +y up, +z out of the face, origin
between the jaw hinges; one object per part) and `landmarks.json` (the 68 iBUG landmarks).
The same seed gives the same files.
"""

import json
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from training import DATA, shipped
from training.default_head import parts, skin
from training.default_head.parts import Part
from training.flags import run_command
from training.landmarks.canonical import from_ict

EYEBALLS = {"eye_left": (21451, 23020), "eye_right": (23021, 24590)}
TEETH = {"teeth_upper": (17039, 19246), "teeth_lower": (19247, 21450)}
IDENTITY_SPREAD = 0.75
COLOURS = {
    "skin": (0.72, 0.50, 0.40),
    "mouth": (0.42, 0.13, 0.13),
    "eye_white": (0.92, 0.91, 0.89),
    "iris": (0.16, 0.30, 0.33),
    "pupil": (0.01, 0.01, 0.01),
    "teeth": (0.88, 0.85, 0.78),
    "tongue": (0.62, 0.25, 0.25),
    "gums": (0.60, 0.24, 0.24),
    "lips": (0.58, 0.30, 0.27),
}


def identity(ict: dict, seed: int) -> np.ndarray:
    """A head near the mean, `[26719, 3]` centimetres."""
    coefficients = np.random.default_rng(seed).normal(0, IDENTITY_SPREAD, 100)
    return ict["neutral"] + np.tensordot(coefficients, ict["identity"].astype(np.float64), 1)


def skin_part(surface: skin.Skin, points: np.ndarray) -> Part:
    """The skin, with the lining of the mouth and the red of the lips as materials of their own."""
    faces = {
        "skin": surface.triangles[~surface.mouth & ~surface.lips],
        "lips": surface.triangles[surface.lips],
        "mouth": surface.triangles[surface.mouth],
    }
    return Part("skin", points, faces)


def write_obj(folder: Path, head: list[Part], header: str) -> None:
    """Writes one object per part and one material per kind of surface."""
    lines, first = [f"# {line}" for line in header.splitlines()] + ["mtllib head.mtl"], 1
    for part in head:
        lines.append(f"o {part.name}")
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in from_ict(part.points)]
        for material, faces in part.faces.items():
            lines.append(f"usemtl {material}")
            lines += [f"f {a} {b} {c}" for a, b, c in (faces + first).tolist()]
        first += len(part.points)
    (folder / "head.obj").write_text("\n".join(lines) + "\n")
    materials = [f"newmtl {n}\nKd {r} {g} {b}\n" for n, (r, g, b) in COLOURS.items()]
    (folder / "head.mtl").write_text("\n".join(materials))


def write_landmarks(folder: Path, surface: skin.Skin, points: np.ndarray) -> None:
    """Writes the stable landmark format. The skin comes first, so its vertex numbers match the file."""
    entries = [
        {
            "index": i,
            "position": [round(float(x), 6) for x in from_ict(points[v])],
            "vertex": int(v),
            "confidence": 1.0,
        }
        for i, v in enumerate(surface.landmarks)
    ]
    lines = ",\n  ".join(json.dumps(e) for e in entries)
    (folder / "landmarks.json").write_text(f'{{\n "version": 1,\n "landmarks": [\n  {lines}\n ]\n}}\n')


HEAD = shipped("default_head")


def main(data: Path = DATA, seed: int = 11, out: Path = HEAD) -> None:
    """Entry of the command."""
    out.mkdir(parents=True, exist_ok=True)
    ict = load_file(data / "faces/ict_facekit.safetensors")
    neutral = ict["neutral"].astype(np.float64)
    surface = skin.build(neutral, ict["triangles"], ict["landmarks68"], seed=0)
    whole = identity(ict, seed)
    points = surface.weights @ whole
    head = [skin_part(surface, points)]
    head += [parts.eye(n, whole[a : b + 1]) for n, (a, b) in EYEBALLS.items()]
    head += [parts.teeth(n, whole[a : b + 1], n == "teeth_upper") for n, (a, b) in TEETH.items()]
    first, last = TEETH["teeth_lower"]
    head.append(parts.tongue(whole[first : last + 1]))
    header = (
        f"Anyface default head, seed {seed}; made by training/default_head/make.py\n"
        "Shape sampled from USC ICT FaceKit, Copyright (c) 2020 USC Institute for Creative "
        "Technologies, MIT licence; triangulation, eyes, teeth and tongue are Anyface's own."
    )
    write_obj(out, head, header)
    write_landmarks(out, surface, points)
    count = sum(len(p.points) for p in head)
    print(f"{out}: {count} vertices, {sum(len(f) for p in head for f in p.faces.values())} triangles")


if __name__ == "__main__":
    run_command(main)
