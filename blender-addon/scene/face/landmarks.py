"""The 68 landmarks of a face: stored on its object, searched for, and dragged one at a time."""

import json
from dataclasses import dataclass, field

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ...core import finding, json_file, wording
from ...core.errors import AnyfaceError
from ...core.job import Progress
from ...core.take import LIDS, MOUTHS, FaceMesh, Found
from . import mesh, rest

COUNT = 68
# How the lips meet, in words.
_MOUTHS = {
    "open": "the mouth stands open",
    "slit": "the lips part",
    "welded": "the lips are one surface and cannot part",
}
# Chains and loops of iBUG 300-W, as they are drawn.
CHAINS = (range(17), range(17, 22), range(22, 27), range(27, 31), range(31, 36))
LOOPS = (range(36, 42), range(42, 48), range(48, 60), range(60, 68))
REGIONS = {
    "mouth": range(48, 68),
    "eyes": range(36, 48),
    "brows": range(17, 27),
    "nose": range(27, 36),
    "jaw": range(17),
}
# Points that an artist clicks to show where the face is: the landmark, and its name for the artist.
CLICKS = (
    (36, "the outer corner of the eye on the left of the picture"),
    (45, "the outer corner of the eye on the right of the picture"),
    (30, "the tip of the nose"),
    (48, "the corner of the mouth on the left of the picture"),
    (54, "the corner of the mouth on the right of the picture"),
)
DOUBTFUL = 0.4
"""An artist should check a region if the mean confidence of its landmarks is below this."""


@dataclass
class Stored:
    """Landmarks as they are stored on an object.

    `positions` `[68, 3]` are in object space, `confidence` is `[68]`, and `fixed` holds the numbers
    of the landmarks that the artist has placed.
    """

    positions: np.ndarray
    confidence: np.ndarray
    mouth: str = ""
    lids: tuple[str, str] = ("close", "close")
    fixed: set[int] = field(default_factory=set)

    @property
    def sure(self) -> float:
        """The mean confidence, 0 to 1."""
        return float(self.confidence.mean())

    @property
    def doubtful(self) -> list[str]:
        """Names of the regions that an artist should check; landmarks placed by hand count as
        certain."""
        by_hand = np.isin(np.arange(COUNT), list(self.fixed))
        confidence = np.where(by_hand, 1.0, self.confidence)
        return [
            name for name, indices in REGIONS.items() if confidence[list(indices)].mean() < DOUBTFUL
        ]


def load(ob) -> Stored | None:
    """The landmarks stored on `ob`, or None. Raises `AnyfaceError` for text without landmarks."""
    text = ob.get(mesh.LANDMARKS_PROPERTY)
    points, vertices = mesh.read_landmarks(ob)
    if points is None and vertices is None:
        return None
    if points is None:
        basis = mesh.read_basis(ob.data)
        if vertices.max() >= len(basis):
            text = f"expected landmarks on its {len(basis)} vertices, got {vertices.max()}"
            raise AnyfaceError("input", f"{ob.name}: {text}: find them again")
        points = basis[vertices]
    stored = Stored(np.asarray(points, dtype=np.float64), np.ones(COUNT))
    rows = _rows(text)
    if rows is not None:
        # Anybody may have written the text. What does not fit counts as missing.
        confidence = [row.get("confidence", 1.0) for row in rows["landmarks"]]
        if len(confidence) == COUNT and all(isinstance(one, int | float) for one in confidence):
            stored.confidence = np.array(confidence, dtype=np.float64)
        if rows.get("mouth") in MOUTHS:
            stored.mouth = rows["mouth"]
        lids = rows.get("lids")
        if isinstance(lids, list) and len(lids) == 2 and all(lid in LIDS for lid in lids):
            stored.lids = tuple(lids)
        numbers = [row["index"] for row in rows["landmarks"] if row.get("fixed")]
        stored.fixed = {number for number in numbers if number in range(COUNT)}
    return stored


def _rows(text) -> dict | None:
    if not isinstance(text, str) or not text.lstrip().startswith("{"):
        return None
    value = json_file.parse(text)
    if "landmarks" not in value:
        return None
    value["landmarks"].sort(key=lambda row: row["index"])
    return value


def store(ob, face_points: Found, fixed=()) -> None:
    """Writes the landmarks `face_points` on `ob` in the format of a landmark file.

    `fixed` holds the numbers of the landmarks that the artist has placed. Raises
    `AnyfaceError("mesh")` for a linked object.
    """
    if ob.library is not None or not ob.is_editable:
        text = f"{ob.name} is linked: make it local to keep the points of its face on it"
        raise AnyfaceError("mesh", text, ("make_local",))
    rows = []
    for number in range(COUNT):
        row = {
            "index": number,
            "position": [round(float(x), 9) for x in face_points.positions[number]],
            "vertex": int(face_points.vertices[number]),
            "confidence": round(float(face_points.confidence[number]), 4),
        }
        rows.append(row | ({"fixed": True} if number in fixed else {}))
    confidence = round(float(face_points.confidence.mean()), 4)
    document = {
        "version": 1,
        "confidence": confidence,
        "mouth": face_points.mouth,
        "landmarks": rows,
    }
    document["lids"] = list(face_points.lids)
    document["box"] = mesh.box_of(mesh.read_basis(ob.data)).round(6).tolist()
    ob[mesh.LANDMARKS_PROPERTY] = json.dumps(document)


def clear(ob) -> None:
    """Removes the stored landmarks: the next run searches for them."""
    if mesh.LANDMARKS_PROPERTY in ob:
        del ob[mesh.LANDMARKS_PROPERTY]


_NO_BLINK = {
    "shut": "sculpted shut, the brow squints instead of a blink",
    "joined": "no slit between the lids, the brow squints instead of a blink",
}


def _eyes(both: tuple[str, str], lids: str) -> str:
    """Names the eyes whose lids are in the state `lids`."""
    named = [side for side, state in zip(("right", "left"), both, strict=True) if state == lids]
    return "both eyes" if len(named) == 2 else f"{named[0]} eye"


def describe(stored: Stored) -> str:
    """Describes landmarks: "face found, 97 % sure; the lips part"."""
    text = f"face found, {round(100 * stored.sure)} % sure"
    if stored.mouth:
        text += f"; {_MOUTHS.get(stored.mouth, stored.mouth)}"
    for lids, why in _NO_BLINK.items():
        if lids in stored.lids:
            text += f"; {_eyes(stored.lids, lids)}: {why}"
    if stored.fixed:
        text += f"; {len(stored.fixed)} put by hand"
    if stored.doubtful:
        text += f"; not sure of {wording.listed(stored.doubtful)}: drag the orange points"
    return text


@dataclass
class Search:
    """A snapshot for finding landmarks; `work` needs no Blender data, so any thread may run it."""

    face: FaceMesh
    engine: object
    fixed: dict[int, np.ndarray] = field(default_factory=dict)
    confidence: np.ndarray | None = None

    def work(self, progress: Progress) -> Found:
        """The landmarks in object space; raises `AnyfaceError`.

        After a drag, no landmark gets less confidence than it had before (`confidence` `[68]`).
        """
        face_points = finding.find(self.face, self.fixed, self.engine.find, progress)
        if self.confidence is not None:
            face_points.confidence = np.maximum(face_points.confidence, self.confidence)
        return face_points


def ask_for_click(number: int) -> str:
    """Says what to click next, after `number` points."""
    what = CLICKS[number][1]
    return f"Click {number + 1} of {len(CLICKS)}: {what}; Backspace takes one back, Esc ends"


class Surface:
    """The Basis of a face as a surface for ray casts, in object space."""

    def __init__(self, ob):
        points = mesh.read_basis(ob.data)
        triangles = mesh.read_triangles(ob.data)
        self._tree = BVHTree.FromPolygons(points.tolist(), triangles.tolist(), all_triangles=True)

    def hit(self, origin, direction) -> np.ndarray | None:
        """Where a ray from `origin` `[3]` first meets the surface, or None."""
        place = self._tree.ray_cast(Vector(origin), Vector(direction))[0]
        return None if place is None else np.array(place)

    def nearest(self, point) -> np.ndarray:
        """The point of the surface nearest to `point` `[3]`."""
        return np.array(self._tree.find_nearest(Vector(point))[0])


class Drag:
    """Drags one landmark over the surface with the pointer; when it stops, the others follow."""

    def __init__(self, ob, surface: Surface | None = None):
        self.stored = load(ob)
        if self.stored is None:
            text = f"{ob.name}: find the face first, or place five points of it where none is found"
            raise AnyfaceError("face", text, ("place_points",))
        self._before = self.stored.positions.copy()
        self.surface = surface or Surface(ob)
        self.number: int | None = None

    def hold(self, number: int) -> None:
        """Takes hold of landmark `number`, 0 to 67."""
        if not 0 <= number < COUNT:
            raise AnyfaceError("input", f"point: expected 0 to {COUNT - 1}, got {number}")
        self.number = number

    def hold_near(self, at: np.ndarray, places: np.ndarray, reach: float) -> bool:
        """Takes hold of the landmark nearest to `at` `[2]` within `reach`; False where none is
        near.

        `places` `[68, 2]` are NaN for landmarks out of view.
        """
        apart = np.linalg.norm(places - at, axis=1)
        apart = np.where(np.isnan(apart), np.inf, apart)
        self.number = int(apart.argmin()) if apart.min() <= reach else None
        return self.number is not None

    def move(self, origin, direction) -> bool:
        """Moves the landmark to where a ray in object space meets the face; False where it
        misses."""
        place = self.surface.hit(origin, direction)
        if place is None or self.number is None:
            return False
        self.stored.positions[self.number] = place
        return True

    def search(self, face: FaceMesh, engine) -> Search:
        """A search that moves the other landmarks, except those that the artist has placed."""
        self.stored.fixed.add(self.number)
        face.landmarks, face.landmark_vertices = self._before, None
        fixed = {number: self.stored.positions[number] for number in sorted(self.stored.fixed)}
        return Search(face, engine, fixed, self.stored.confidence)


def head(ob) -> tuple[np.ndarray, float]:
    """Centre `[3]` and radius of the head in the world, from landmarks or else from the object's
    box."""
    stored = load(ob)
    if stored is None:
        box = mesh.corners(ob)
        return box.mean(axis=0), 0.75 * float(np.ptp(box, axis=0).max())
    matrix = rest.world(ob)
    world = stored.positions @ matrix[:3, :3].T + matrix[:3, 3]
    # Chin to brows is half the height of a head.
    return world.mean(axis=0), 1.5 * float(np.ptp(world, axis=0).max())
