"""Packs the default head for *Add > Mesh > Anyface Sample Head* of the Blender extension.

    python -m training.sample_head

reads `weights/shared/default_head/head.obj` and `head.mtl` and writes
`blender-addon/sample_head.npz`: `positions` `[V, 3]` (integers, micrometres, axes of the file) and
`triangles` `[F, 3]`, both as `planes` writes them, `materials` `[F]` (numbers of `names`), `names`
`[M]` and `colours` `[M, 3]` (linear, 0 to 1). The same head gives the same file.
"""

from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
HEAD = ROOT / "weights/shared/default_head/head.obj"
PACKED = ROOT / "blender-addon/sample_head.npz"
MICROMETRES = 1e6


def read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of the packed file, from an OBJ and the MTL beside it."""
    colours = read_colours(path.with_suffix(".mtl"))
    names, material = list(colours), 0
    positions, triangles, materials = [], [], []
    for line in path.read_text().splitlines():
        kind, *values = line.split() or [""]
        if kind == "usemtl":
            material = names.index(values[0])
        elif kind == "v":
            positions.append([float(value) for value in values])
        elif kind == "f":
            triangles.append([int(value) - 1 for value in values])
            materials.append(material)
    return {
        "positions": planes(np.rint(np.array(positions) * MICROMETRES)),
        "triangles": planes(np.array(triangles)),
        "materials": np.array(materials, dtype="u1"),
        "names": np.array(names),
        "colours": np.array([colours[name] for name in names], dtype="<f4"),
    }


def planes(rows: np.ndarray) -> np.ndarray:
    """Whole numbers `[N, 3]` as bytes `[4, 3 N]`, which take half the space in a zip.

    Each number becomes its difference from the row before, column after column. The lowest bytes of
    all differences come first. `_rows` in blender-addon/scene/face/sample_head.py is the inverse.
    """
    differences = np.diff(rows, axis=0, prepend=0).astype("<i4")
    every_byte = np.ascontiguousarray(differences.T).view("u1").reshape(-1, 4)
    return np.ascontiguousarray(every_byte.T)


def read_colours(path: Path) -> dict[str, list[float]]:
    """The diffuse colour of each material of an MTL."""
    colours, name = {}, ""
    for line in path.read_text().splitlines():
        kind, *values = line.split() or [""]
        if kind == "newmtl":
            name = values[0]
        elif kind == "Kd":
            colours[name] = [float(value) for value in values]
    return colours


def main() -> None:
    """Entry of the command."""
    np.savez_compressed(PACKED, **read(HEAD))
    print(f"{PACKED}: {PACKED.stat().st_size} bytes")


if __name__ == "__main__":
    main()
