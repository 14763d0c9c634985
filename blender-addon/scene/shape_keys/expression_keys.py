"""Adds ARKit's shapes as the artist's own shape keys. Nothing animates them yet."""

from dataclasses import dataclass

import numpy as np

from ...core import finding, plan, shapes
from ...core.job import Progress
from ...core.take import NETWORK, FaceMesh, Rig, ShapesBy
from ..face import mesh, pieces
from . import guard

HALF = "_half"
# A driver expression of the slider w: 0 at both ends, 1 halfway. Blender evaluates it without
# Python.
HALFWAY = "1 - abs(2 * w - 1)"


@dataclass
class Making:
    """A snapshot of a face; `work` needs no Blender data, so any thread may run it."""

    face: FaceMesh
    engine: object
    by: ShapesBy = NETWORK

    def work(self, progress: Progress) -> Rig:
        """The shapes in object space; raises `AnyfaceError`."""
        with finding.naming(self.face):
            return plan.make_rig(self.face, self.engine, progress, self.by)


def objects(ob, face: FaceMesh) -> list:
    """`ob` and the parts that move with it; raises `AnyfaceError("mesh")` where a part is gone."""
    return [ob, *(pieces.object_of(pieces.Part(piece.name), ob) for piece in face.pieces[1:])]


def add(ob, face: FaceMesh, rig: Rig, left_out=()) -> tuple[list[str], np.ndarray]:
    """Adds keys for a face's shapes to `ob` and to the parts that move with it.

    Shapes in `left_out` get no key. Returns the names and vectors `[S, V, 3]` of the keys. Raises
    `AnyfaceError` where the mesh has changed or a part is gone; nothing has changed then.
    """
    rows = [row for row, name in enumerate(rig.names) if name not in left_out]
    names, vectors = [rig.names[row] for row in rows], rig.vectors[rows]
    moved = [(one, plan.of_piece(face, vectors, one.name)[1]) for one in objects(ob, face)]
    for one, part_vectors in moved:
        guard.check_editable(one)
        guard.check_size(one, part_vectors.shape[1])
    for one, part_vectors in moved:
        _add(one, names, part_vectors, everything=one == ob)
    return names, vectors


def _add(ob, names: list[str], vectors: np.ndarray, everything: bool) -> None:
    """Adds keys that nothing animates yet, from `vectors` `[S, V, 3]` in object space.

    Keys that move nothing are left out, unless `everything` is set.
    """
    numbers = [number for number in range(len(names)) if everything or vectors[number].any()]
    if not numbers:
        return
    with guard.object_mode(ob), guard.selection_kept(ob):
        if ob.data.shape_keys is None:
            ob.shape_key_add(name="Basis", from_mix=False)
        rest = mesh.read_basis(ob.data)
        for number in numbers:
            mesh.add_key(ob, names[number], rest + vectors[number])
        ob.data.update()


def bent(rig: Rig) -> Rig:
    """A copy of the rig in which half of `NAME` is subtracted from each `NAME_half`."""
    rows = {name: row for row, name in enumerate(rig.names)}
    vectors = rig.vectors.copy()
    for name in shapes.ARKIT:
        if name + HALF in rows:
            vectors[rows[name + HALF]] -= 0.5 * vectors[rows[name]]
    return Rig(rig.names, vectors, rig.notes)


def drive(ob, face: FaceMesh) -> None:
    """Adds drivers: sliders of `ob` drive its halfway keys, and keys of the parts follow `ob`."""
    face_keys = ob.data.shape_keys
    for name in shapes.ARKIT:
        if name + HALF in face_keys.key_blocks:
            _driven(face_keys, name + HALF, face_keys, name, HALFWAY)
    for one in objects(ob, face):
        part = one.data.shape_keys
        if one == ob or part is None:
            continue
        for name in (*shapes.ARKIT, *(name + HALF for name in shapes.ARKIT)):
            if name in part.key_blocks and name in face_keys.key_blocks:
                _driven(part, name, face_keys, name, "w")


def _driven(of, name: str, by, source: str, expression: str) -> None:
    driver = of.key_blocks[name].driver_add("value").driver
    variable = driver.variables.new()
    variable.name = "w"
    variable.targets[0].id_type, variable.targets[0].id = "KEY", by
    variable.targets[0].data_path = f'key_blocks["{source}"].value'
    driver.expression = expression
