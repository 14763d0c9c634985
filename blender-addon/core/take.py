"""Plain data that the stages exchange: requests, meshes, sounds and results."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .events import Event
from .heard_emotion import HeardEmotion
from .sliders import NAMES, SliderChange
from .space import FaceSpace, face_space

# Pairs of landmarks on the upper and the lower inner lip that meet.
_LIPS = np.array([[61, 67], [62, 66], [63, 65]])
# How the lips of a mesh meet, in the order of `AnyfaceMouth`.
MOUTHS = ("open", "slit", "welded")
# What the lids of an eye can do, in the order of `AnyfaceLids`.
LIDS = ("close", "shut", "joined")
# What a part of a mesh is, in the order of `AnyfacePartRole`.
ROLES = ("skin", "jaw", "skull", "mouth", "nearest", "gaze", "still")
# Marks an object whose parts are recognised by shape and place.
BY_SHAPE = -1


@dataclass
class PartRoles:
    """The roles that the artist gave to whole objects and to single connected parts.

    `object_of_vertex` `[V]` uint32 says which object each vertex belongs to. `object_roles` has an
    index into `ROLES`, or `BY_SHAPE`, for each object. `numbers` and `number_roles` give single
    parts a role, which overrides the role of their object.
    """

    object_of_vertex: np.ndarray
    object_roles: list[int] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    number_roles: list[int] = field(default_factory=list)


@dataclass
class Found:
    """Where a face is, in the coordinates in which its mesh was given.

    The landmarks: `positions` `[68, 3]`, `vertices` `[68]`, `confidence` `[68]` 0 to 1. `mouth` is
    one of `MOUTHS`. `lids` holds one of `LIDS` for the right and for the left eye. `part_roles` is
    an index into `ROLES` for each part, `part_of_vertex` `[V]` the part of each vertex.
    """

    positions: np.ndarray
    vertices: np.ndarray
    confidence: np.ndarray
    mouth: str
    part_roles: np.ndarray
    part_of_vertex: np.ndarray
    lids: tuple[str, str] = ("close", "close")

    def lips(self, count: int) -> np.ndarray:
        """Pairs `[N, 2]` of vertices where upper and lower lip meet, among the first `count`."""
        pairs = np.asarray(self.vertices, dtype=np.uint32)[_LIPS]
        is_inside = (pairs < count).all(axis=1) & (pairs[:, 0] != pairs[:, 1])
        return np.ascontiguousarray(pairs[is_inside])


@dataclass
class OpenedFace:
    """A mesh whose lips were parted, or whose eyes were cut free.

    The old vertices come first and stay in place. The old triangles keep their order; those that
    were cut are there in pieces. The surface behind the cut comes last.

    `positions` `[V, 3]`, `triangles` `[F, 3]`, `landmarks` `[68, 3]` near `landmark_vertices`. Each
    vertex mixes the old vertices `vertex_sources` `[V, 3]` by `vertex_shares` `[V, 3]`. Each
    triangle was cut from the old triangle `triangle_sources` `[F]`; each of its corners mixes the
    old triangle's corners by `corner_shares` `[F, 3, 3]`. Triangles from `first_lining_triangle` on
    are new and have the colour of the surface in front of them. Triangles from
    `first_inside_triangle` on are the inside of the mouth.
    """

    positions: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray
    landmark_vertices: np.ndarray
    vertex_sources: np.ndarray
    vertex_shares: np.ndarray
    triangle_sources: np.ndarray
    corner_shares: np.ndarray
    first_lining_triangle: int
    first_inside_triangle: int


# What a viewer sees of a face, in the order of `AnyfaceVisibility`.
VISIBILITIES = ("SPEAKS", "LIPS_REST", "NOTHING")
# Where the emotion comes from. A source other than "GIVEN" has a word where an emotion could be
# written.
EMOTION_SOURCES = ("GIVEN", "VOICE", "OFF", "AROUSAL")
EMOTION_WORDS = {"auto": "VOICE", "auto-arousal": "AROUSAL", "off": "OFF"}
WORD_OF_SOURCE = {source: word for word, source in EMOTION_WORDS.items()}


@dataclass
class Request:
    """How the character shall speak, and in which form its motion is wanted.

    `fields` are values by the names of `systems.Field`; fields that are left out have their
    defaults. A text stands as it is. Intervals are `[N, 2]`, seconds. A pose is `[V, 3]`,
    displacements from rest. An emotion is a text such as "happy:0.7" or "auto", or a list of
    `(time_s, strengths[15])` in rising order, times from the first sample.

    `controls` are numbers by the names of `systems.Control`; controls that are left out have their
    defaults. Controls in `control_keys` follow `(times_s [N], values [N])` instead, linear in
    between. `roles` is what the artist says about the mesh's parts. `error_mm` is the largest error
    of a basis, on a head of human size; None asks for the displacements of every frame instead of a
    basis. `keeps_clip` asks for neither of them but for the clip itself, on which weights of shapes
    are solved. `events` are for systems that take them. A `layered` take keeps the emotion in
    vectors of its own. `output` names the output that writes the motion. With `named_keys` the
    vectors of a basis follow controls and have their names. Without it they are chosen so that the
    fewest of them move in a frame.
    """

    fps: float
    fields: dict[str, Any] = field(default_factory=dict)
    error_mm: float | None = 0.1
    controls: dict[str, float] = field(default_factory=dict)
    control_keys: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    roles: PartRoles | None = None
    events: list[Event] = field(default_factory=list)
    layered: bool = False
    output: str = ""
    keeps_clip: bool = False
    named_keys: bool = True

    def with_fields(self, **more) -> "Request":
        """A copy with other values of some fields."""
        return replace(self, fields=self.fields | more)


@dataclass
class Sound:
    """Mono samples `[S]`, float32 in -1..1, at `rate_hz`; `name` is for messages."""

    samples: np.ndarray
    rate_hz: float
    name: str

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return len(self.samples) / self.rate_hz


@dataclass
class Piece:
    """One of several objects that make up a face; its vertices are `first` to `first + count`.

    `matrix` `[4, 4]` leads from its own space to the space of the face object. `role` is an index
    into `ROLES`, or `BY_SHAPE`.
    """

    name: str
    first: int
    count: int
    matrix: np.ndarray
    role: int = BY_SHAPE

    @property
    def rows(self) -> slice:
        """The rows of its vertices among the vertices of the whole face."""
        return slice(self.first, self.first + self.count)

    def vectors(self, moved: np.ndarray) -> np.ndarray:
        """Its part of the face's displacements `[N, V, 3]`, in its own space."""
        moved_here = np.ascontiguousarray(moved[:, self.rows])
        back = np.linalg.inv(self.matrix[:3, :3]).astype(np.float32)
        return moved_here if np.array_equal(back, np.eye(3)) else moved_here @ back.T


@dataclass
class FaceMesh:
    """A mesh as Blender holds it.

    `positions` `[V, 3]` float32 of the Basis in object space, `triangles` `[F, 3]` uint32,
    `matrix_world` `[4, 4]` from object space to the world. Landmarks, where the artist gave
    them, are `[68, 3]` positions in object space or `[68]` vertex numbers. `hints` are remarks
    that make an error easier to understand ("the Mirror modifier is not applied"). If teeth, eyes
    or lashes are separate objects, `pieces` says which vertices belong to which, the face first.
    With `stands_in` it is another head that moves in place of a mesh without a face.
    """

    name: str
    positions: np.ndarray
    triangles: np.ndarray
    matrix_world: np.ndarray
    landmarks: np.ndarray | None = None
    landmark_vertices: np.ndarray | None = None
    axes: str = "AUTO"
    hints: list[str] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    roles: PartRoles | None = None
    stands_in: bool = False

    @property
    def space(self) -> FaceSpace:
        """The map to the library's coordinates; raises `AnyfaceError("mesh")` if scaled to zero."""
        return face_space(self.matrix_world, self.axes)


class Motion:
    """The motion of a take; there is a subclass for each way to write it.

    If it is written as keys, `vectors` `[K, V, 3]` are the displacements of these keys, or None for
    the artist's own keys. `weights` `[T, K]` are animated; None means that each key is a frame.
    """

    # The files beside the .blend that hold it.
    files: "Sequence[WrittenFile]" = ()

    @property
    def frame_count(self) -> int:
        """The number of frames `T`."""
        raise NotImplementedError

    def of_piece(self, piece: Piece) -> "Motion":
        """The motion of one object of the face, in the space of that object."""
        raise NotImplementedError


@dataclass
class CurveKeys:
    """The keys of one curve.

    `rows` `[N]` are their frames, rising from the first frame of the take to the last one.
    `slopes` `[N]` are the slopes of their handles, per frame.
    """

    rows: np.ndarray
    slopes: np.ndarray


@dataclass
class HeldKeys:
    """The keys of a curve at the frames `rows` `[N]`; it holds each value until the next key."""

    rows: np.ndarray


@dataclass
class Frames(Motion):
    """The `displacements` of every frame, `[T, V, 3]`."""

    displacements: np.ndarray
    weights = None

    @property
    def frame_count(self):
        return len(self.displacements)

    @property
    def vectors(self):
        return self.displacements

    def of_piece(self, piece):
        return Frames(piece.vectors(self.displacements))


@dataclass
class ClipMotion(Motion):
    """A `native_shapes.Clip`: the library keeps the frames until weights are solved on them.

    `way` `[3, 3]` maps the displacements of the clip to object space.
    """

    clip: Any
    way: np.ndarray

    @property
    def frame_count(self):
        return self.clip.shape[0]


class VectorSum(Motion):
    """`vectors` `[K, V, 3]` whose `weights` `[T, K]` add up to the motion.

    `keys_of_curves` `[K]` are the keys of the weights' curves. None, for one curve or for all of
    them, means a key on every frame.
    """

    weights: np.ndarray
    vectors: np.ndarray | None
    keys_of_curves: list[CurveKeys | None] | None = None

    @property
    def frame_count(self):
        return len(self.weights)

    def of_piece(self, piece):
        return replace(self, vectors=piece.vectors(self.vectors))


@dataclass
class Basis(VectorSum):
    """Displacements as a few vectors and their weights.

    `vectors` `[K, V, 3]`, `weights` `[T, K]` within -1..1. `error_mm` is the largest distance of
    any vertex in any frame from where it should be. `sliders` holds the changes that can still be
    made to the take, by the names of `sliders.ALL`; `why_missing` says why the others are missing.
    `offered` are all sliders that the system has. `packed` holds `sliders` in the form that is
    stored with the take. The vectors from `emotion_first` on show the emotion, those before it the
    speech. `names` `[K]` say what each vector does; the list is empty if they have no names.
    """

    vectors: np.ndarray
    weights: np.ndarray
    error_mm: float
    sliders: dict[str, SliderChange] = field(default_factory=dict)
    why_missing: dict[str, str] = field(default_factory=dict)
    packed: bytes = b""
    offered: tuple[str, ...] = NAMES
    emotion_first: int | None = None
    keys_of_curves: list[CurveKeys | None] | None = None
    names: list[str] = field(default_factory=list)

    def of_piece(self, piece):
        # An emotion mask can be painted on the face object only.
        emotion_first = self.emotion_first if piece.first == 0 else None
        return replace(super().of_piece(piece), emotion_first=emotion_first)


@dataclass
class Life:
    """The motion of head and eyes that goes with a take.

    `head` `[T, 3]` rotation vectors about canonical axes (+x to the subject's left, +y up, +z out
    of the face), radians; `gaze` `[T, 2, 2]`: right eye, left eye; yaw to the left and pitch up.
    `way` `[3, 4]` maps the coordinates in which the mesh was given to canonical ones, in metres on
    a human head. `looked_at` `[T, 3]`, canonical, are the points at which the eyes look. `tongue`
    `[T, 4]` says how close the tongue is to contact, 0 to 1: the tip with the ridge behind the
    upper teeth, the middle and the back with the palate, the tip with the upper teeth. The
    displacements already contain this motion.
    """

    head: np.ndarray
    gaze: np.ndarray
    way: np.ndarray
    looked_at: np.ndarray | None = None
    tongue: np.ndarray | None = None


@dataclass
class Landmarks:
    """The 68 landmarks of a take: `neutral` `[68, 3]` at rest and `displacements` `[T, 68, 3]`."""

    neutral: np.ndarray
    displacements: np.ndarray


@dataclass
class ShapeWeights:
    """Motion as the system made it: weights `[T, S]`, 0 to 1, of ARKit's shapes `names` `[S]`."""

    names: list[str]
    weights: np.ndarray

    def of(self, names: list[str]) -> np.ndarray:
        """The weights `[T, N]` of the shapes `names`, 0 for a shape that it does not have."""
        weights = np.zeros((len(self.weights), len(names)), dtype=np.float32)
        for column, name in enumerate(names):
            if name in self.names:
                weights[:, column] = self.weights[:, self.names.index(name)]
        return weights

    def missing(self, names: list[str], least: float = 0.1) -> list[str]:
        """The shapes outside `names` whose weights reach `least`, the strongest first."""
        peaks = self.weights.max(axis=0, initial=0.0)
        order = [int(at) for at in np.argsort(-peaks) if peaks[at] >= least]
        return [self.names[at] for at in order if self.names[at] not in names]

    def left_out(self, names: list[str]) -> float:
        """The share of all weights that shapes outside `names` have, root mean square."""
        missing = [at for at, name in enumerate(self.names) if name not in names]
        energy = (self.weights.astype(np.float64) ** 2).sum(axis=0)
        return float(np.sqrt(energy[missing].sum() / max(energy.sum(), 1e-20)))


@dataclass
class Animation:
    """The result of the library for one mesh, in the coordinates in which the mesh was given.

    It holds a `basis`, `displacements` `[T, V, 3]` float32 or a `native_shapes.Clip`, depending on
    the request. `largest_mm` is the largest displacement of any vertex in any frame, on a head of
    human size, blinks included. `visibility` is one of `VISIBILITIES`. `shape_weights` is the
    motion of a system that makes weights. `heard_emotion` is the emotion heard in the voice, if the
    motion depends on it. `mouth` is how the lips meet, one of `MOUTHS`; `lids` is what the lids of
    both eyes do, two of `LIDS`. `notes` are remarks for the report. A mesh unit is `unit_mm` long
    on a head of human size. `touching` `[T]` marks the frames in which the lips touch.
    """

    largest_mm: float
    visibility: str = "SPEAKS"
    basis: Basis | None = None
    displacements: np.ndarray | None = None
    clip: Any = None
    life: Life | None = None
    landmarks: Landmarks | None = None
    shape_weights: ShapeWeights | None = None
    heard_emotion: HeardEmotion | None = None
    mouth: str = ""
    lids: tuple[str, str] = ("close", "close")
    notes: list[str] = field(default_factory=list)
    unit_mm: float = 1000.0
    touching: np.ndarray | None = None


@dataclass
class Take:
    """A finished performance in object space, ready to be written.

    `output` names the output that the take is made for. `motion` is what this output writes, in
    object units. `largest_mm` is the largest displacement of any vertex. `life` holds head and
    eyes; its `way` maps world coordinates to canonical ones. `largest_of` is the largest
    displacement of each piece, mm, if the face has several. `shape_weights` are weights that the
    system made itself: named keys get them unchanged. `heard_emotion` is the emotion heard in the
    voice, if the take depends on it. `mouth` is how the lips meet, one of `MOUTHS`; `lids` is what
    the lids of both eyes do, two of `LIDS`. `notes` are remarks for the report. No keyframe lies
    before the scene frame `earliest`, unless the sound begins before it. An object unit is
    `unit_mm` long on a head of human size. `touching` `[T]` marks the frames in which the lips
    touch.
    """

    fps: float
    largest_mm: float
    output: str
    motion: Motion
    life: Life | None = None
    largest_of: list[float] = field(default_factory=list)
    shape_weights: ShapeWeights | None = None
    heard_emotion: HeardEmotion | None = None
    mouth: str = ""
    lids: tuple[str, str] = ("close", "close")
    notes: list[str] = field(default_factory=list)
    earliest: float = -np.inf
    unit_mm: float = 1000.0
    touching: np.ndarray | None = None
    # How much farther than at rest the lips are apart in each frame, mm, if known.
    opening: np.ndarray | None = None
    # A `sparse.Few`, which finds the keys of curves made in Blender; None puts one on every frame.
    few: object = None

    def scene_frames(self, start_frame: float, scene_fps: float) -> np.ndarray:
        """The scene frames `[T]` of its frames; the first one lies at `start_frame`."""
        return start_frame + np.arange(self.frame_count) * (scene_fps / self.fps)

    @property
    def frame_count(self) -> int:
        """The number of frames `T`."""
        return self.motion.frame_count


@dataclass(frozen=True)
class ShapesBy:
    """What moves the skin in shapes: a network, or the `field` of the head most like the face.

    With `in_betweens` there are ARKit's shapes at weight 0.5 as well, named `NAME_half`.
    """

    field: bool = False
    in_betweens: bool = False


NETWORK = ShapesBy()


@dataclass
class Rig:
    """Shapes of one mesh: `names` `[S]`, `vectors` `[S, V, 3]` at strength 1.

    `notes` say why some of the shapes move nothing, or less than they should.
    """

    names: list[str]
    vectors: np.ndarray
    notes: dict[str, str] = field(default_factory=dict)


@dataclass
class Solved:
    """Weights `[T, S]`, 0 to 1; `left_out` is the share of the motion that they do not show."""

    weights: np.ndarray
    left_out: float


@dataclass
class KeyMotion(VectorSum):
    """A take as weights of named shape keys.

    `keys` `[S]` are the names of the keys, `weights` `[T, S]` their weights. `vectors` `[S, V, 3]`
    in object space are given for keys that must be made; None means the artist's own keys.
    `visemes` are keys that are made as well, but get no weights. `left_out` is as in `Solved`.

    The other fields are for the artist's keys. `shape_weights` `[T, N]` are the weights of the
    `shapes` `[N]` that the keys show. `shown` names the shape that each key shows most. `factors`
    gives each key's value when one of its shapes is at weight 1. `missing` lists shapes that move
    but that no key shows, if the system made weights.
    """

    keys: list[str]
    weights: np.ndarray
    left_out: float
    vectors: np.ndarray | None = None
    visemes: Rig | None = None
    shapes: list[str] = field(default_factory=list)
    shape_weights: np.ndarray | None = None
    shown: dict[str, str] = field(default_factory=dict)
    factors: dict[str, dict[str, float]] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    keys_of_curves: list[CurveKeys | None] | None = None

    def of_piece(self, piece):
        more = self.visemes
        if more is not None:
            more = replace(more, vectors=piece.vectors(more.vectors))
        return replace(super().of_piece(piece), visemes=more)


@dataclass
class ControlMotion(Motion):
    """A take as the motion of some points of the skin, to which the controls of a rig are fitted.

    `vertices` `[P]` are numbers of vertices near the 68 landmarks, `frames` `[T, P, 3]` their
    motion in object space, `regions` `[P]` indices into `controls_plan.REGIONS`. `pairs` `[N, 2]`
    are points where upper and lower lip meet. An object unit is `mm` long on a head of human size.
    `fitted` is the motion of the rig's controls, once the fit is done. If curves hold poses,
    `pose_frames` `[T]` gives the first frame of the pose that each frame belongs to.
    """

    vertices: np.ndarray
    frames: np.ndarray
    regions: np.ndarray
    pairs: np.ndarray
    mm: float
    fitted: object = None
    pose_frames: np.ndarray | None = None

    @property
    def frame_count(self):
        return len(self.frames)


@dataclass
class WrittenFile:
    """A take of one object as a file of `frames` frames: a point cache of `vertices`, or weights.

    `ease` more frames lead from rest to the take, and as many back to rest. `left_out` is as in
    `Solved`. The file stays at `waits` until it moves to `path`. A file that was at `path` before
    is kept at `earlier` until everything is written. Both are empty if there is no such file.
    """

    object_name: str
    path: str
    frames: int
    vertices: int = 0
    ease: int = 0
    left_out: float = 0.0
    waits: str = ""
    earlier: str = ""


@dataclass
class Files(Motion):
    """A take in files beside the .blend."""

    files: list[WrittenFile]

    @property
    def frame_count(self):
        return self.files[0].frames
