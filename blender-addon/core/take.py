"""Plain data between the stages: what is asked, what is read, what comes back."""

from dataclasses import dataclass, field, replace

import numpy as np

from .events import Event
from .heard_emotion import HeardEmotion
from .sliders import NAMES, SliderChange
from .space import FaceSpace, face_space

# Landmarks of the upper and of the lower inner lip that meet.
_LIPS = np.array([[61, 67], [62, 66], [63, 65]])
# How the lips of a mesh meet, in the order of `AnyfaceMouth`.
MOUTHS = ("open", "slit", "welded")
# What the lids of an eye can do, in the order of `AnyfaceLids`.
LIDS = ("close", "shut", "joined")
# What a part of a mesh is, in the order of `AnyfacePartRole`.
ROLES = ("skin", "jaw", "skull", "mouth", "nearest", "gaze", "still")
# The role of an object whose parts are told by shape and place.
BY_SHAPE = -1


@dataclass
class PartRoles:
    """What the artist says of parts: of whole objects, and of single connected parts.

    `object_of_vertex` `[V]` uint32 and `object_roles`, an index into `ROLES` or `BY_SHAPE` for
    each object; `numbers` and `number_roles` name single parts and count before them.
    """

    object_of_vertex: np.ndarray
    object_roles: list[int] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    number_roles: list[int] = field(default_factory=list)


@dataclass
class Found:
    """Where a face is, in the frame in which its mesh was given.

    `positions` `[68, 3]`, `vertices` `[68]`, `confidence` `[68]` 0 to 1; `mouth` one of `MOUTHS`,
    `lids` of the right and the left eye, of `LIDS`; `part_roles` an index into `ROLES` for each
    part, `part_of_vertex` `[V]`.
    """

    positions: np.ndarray
    vertices: np.ndarray
    confidence: np.ndarray
    mouth: str
    part_roles: np.ndarray
    part_of_vertex: np.ndarray
    lids: tuple[str, str] = ("close", "close")

    def lips(self, count: int) -> np.ndarray:
        """Vertices `[N, 2]` of the upper and of the lower lip that meet, of the first `count`."""
        pairs = np.asarray(self.vertices, dtype=np.uint32)[_LIPS]
        is_inside = (pairs < count).all(axis=1) & (pairs[:, 0] != pairs[:, 1])
        return np.ascontiguousarray(pairs[is_inside])


@dataclass
class OpenedFace:
    """A mesh whose lips were parted, or whose eyes were cut free: old vertices first, where they
    were; old triangles in their order, those that were cut in pieces, then what lies behind.

    `positions` `[V, 3]`, `triangles` `[F, 3]`, `landmarks` `[68, 3]` near `landmark_vertices`. Each
    vertex is a mixture of the old `vertex_sources` `[V, 3]` with `vertex_shares` `[V, 3]`. Each
    triangle lies in the old one `triangle_sources` `[F]`, whose corners have `corner_shares`
    `[F, 3, 3]` in each of its own. From `first_lining_triangle` on triangles are new and
    have the colour of what is before them, from `first_inside_triangle` on a mouth's inside.
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
# Where the emotion comes from, in the order of `AnyfaceEmotionSource`.
EMOTION_SOURCES = ("GIVEN", "VOICE", "OFF", "AROUSAL")
# Words that say so where an emotion is written.
EMOTION_WORDS = {"auto": "VOICE", "auto-arousal": "AROUSAL", "off": "OFF"}


@dataclass
class Request:
    """How the character is asked to speak, and how its motion is to be written.

    `emotion` holds `(time_s, strengths[15])` in rising order, times from the first sample; it is
    used where `emotion_source` is "GIVEN". `controls` are numbers by the names of
    `systems.Control`, of others the default; those in `control_keys` follow
    `(times_s [N], values [N])` instead, linear in between. `roles` is what the artist says of the
    mesh's parts. `error_mm` is the largest error of a basis, on a head of human size; with None the
    displacements of every frame are wanted. With `keeps_clip` neither comes back, but the clip
    itself, on which weights of shapes are solved. The lips close in `closures` `[N, 2]`, seconds;
    with None where that is heard. `events` are for systems that take them, `emotion_of` is another
    recording whose emotion is shown, for those that hear it; where the take is `layered`, what is
    felt has vectors of its own. In `neutral_voice` the same person speaks neutrally: the emotion of
    the voice is heard as what differs from it. `output` names the output that writes it.
    `starts_from` are displacements `[V, 3]` from rest of the pose in which the face begins, for
    systems that go on from one. `named_keys` says whether the vectors of a basis follow controls
    and have their names, or are those of which the fewest move in a frame.
    """

    fps: float
    emotion: list[tuple[float, list[float]]] = field(default_factory=list)
    seed: int = 0
    style: str = ""
    error_mm: float | None = 0.1
    emotion_source: str = "GIVEN"
    controls: dict[str, float] = field(default_factory=dict)
    control_keys: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    roles: PartRoles | None = None
    closures: np.ndarray | None = None
    events: list[Event] = field(default_factory=list)
    emotion_of: "Sound | None" = None
    neutral_voice: "Sound | None" = None
    layered: bool = False
    output: str = ""
    starts_from: np.ndarray | None = None
    keeps_clip: bool = False
    named_keys: bool = True


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
    """One object of a face that is made of several: its vertices are `first` to `first + count`.

    `matrix` `[4, 4]` goes from its own space to that of the face object; `role` is an index into
    `ROLES` or `BY_SHAPE`.
    """

    name: str
    first: int
    count: int
    matrix: np.ndarray
    role: int = BY_SHAPE

    @property
    def rows(self) -> slice:
        """Its vertices among those of the whole face."""
        return slice(self.first, self.first + self.count)

    def vectors(self, moved: np.ndarray) -> np.ndarray:
        """Those of displacements `[N, V, 3]` that are its own, in its own space."""
        moved_here = np.ascontiguousarray(moved[:, self.rows])
        back = np.linalg.inv(self.matrix[:3, :3]).astype(np.float32)
        return moved_here if np.array_equal(back, np.eye(3)) else moved_here @ back.T


@dataclass
class FaceMesh:
    """A mesh as Blender holds it.

    `positions` `[V, 3]` float32 of the Basis in object space, `triangles` `[F, 3]` uint32,
    `matrix_world` `[4, 4]` from object space to the world. Landmarks, where the artist gave
    them, are `[68, 3]` positions in object space or `[68]` vertex numbers. `hints` are remarks
    that make an error easier to understand ("the Mirror modifier is not applied"). Where teeth,
    eyes or lashes are objects of their own, `pieces` says whose the vertices are, the face's first.
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

    @property
    def space(self) -> FaceSpace:
        """The frame in which the library sees it; raises `AnyfaceError("mesh")` for flat ones."""
        return face_space(self.matrix_world, self.axes)


class Motion:
    """What a take holds: a case for each way to write one.

    Of one that becomes keys `vectors` `[K, V, 3]` are what they move, None where they are the
    artist's own, and `weights` `[T, K]` are animated, None where each key is a frame.
    """

    # Where it lies beside the .blend.
    files = ()

    @property
    def frame_count(self) -> int:
        """The number of frames `T`."""
        raise NotImplementedError

    def of_piece(self, piece: Piece) -> "Motion":
        """That of one object of a face, in its own space."""
        raise NotImplementedError


@dataclass
class CurveKeys:
    """The keys of one curve: frames `rows` `[N]` of the take, which rise from the first to the
    last, and the `slopes` `[N]` of their handles, per frame."""

    rows: np.ndarray
    slopes: np.ndarray


@dataclass
class HeldKeys:
    """The keys of a curve whose values are held from each of the frames `rows` `[N]` on."""

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
    """A `native_shapes.Clip`: frames that lie in the library until weights were solved on them.

    `way` `[3, 3]` leads its displacements to object space.
    """

    clip: object
    way: np.ndarray

    @property
    def frame_count(self):
        return self.clip.shape[0]


class VectorSum(Motion):
    """`vectors` `[K, V, 3]` whose `weights` `[T, K]` add up to the motion.

    `keys_of_curves` `[K]` are the keys of their curves; None, as a whole or for one of them, for a
    key a frame.
    """

    keys_of_curves = None

    @property
    def frame_count(self):
        return len(self.weights)

    def of_piece(self, piece):
        return replace(self, vectors=piece.vectors(self.vectors))


@dataclass
class Basis(VectorSum):
    """Displacements as few vectors and their weights.

    `vectors` `[K, V, 3]`, `weights` `[T, K]` within -1..1; `error_mm` is the largest distance
    of any vertex in any frame from where it should be. `sliders` is what may still be changed of
    the take, by the names of `sliders.ALL`; `why_missing` says in words why others are not there.
    `offered` are the sliders that the system has at all; `packed` holds `sliders` as they are kept
    with the take. From `emotion_first` on vectors are what is felt beyond what is said. `names`
    `[K]` say what each vector does; empty where nobody has named them.
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
        # The mask of the emotion is painted on the face alone.
        emotion_first = self.emotion_first if piece.first == 0 else None
        return replace(super().of_piece(piece), emotion_first=emotion_first)


@dataclass
class Life:
    """Head and eyes beside a take.

    `head` `[T, 3]` rotation vectors about canonical axes (+x to the subject's left, +y up, +z out
    of the face), radians; `gaze` `[T, 2, 2]`: right eye, left eye; yaw to the left and pitch up.
    `way` `[3, 4]` leads from the frame in which the mesh was given to the canonical one, metres on
    a human head. `looked_at` `[T, 3]`, canonical, are points on which the eyes rest. `tongue`
    `[T, 4]` are shares of the way to contact, 0 to 1, which the displacements hold: tip to the
    ridge behind the upper teeth, middle and back to the palate, tip at the upper teeth.
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
        """Weights `[T, N]` of shapes of other order, 0 where one is not among them."""
        weights = np.zeros((len(self.weights), len(names)), dtype=np.float32)
        for column, name in enumerate(names):
            if name in self.names:
                weights[:, column] = self.weights[:, self.names.index(name)]
        return weights

    def missing(self, names: list[str], least: float = 0.1) -> list[str]:
        """Shapes beside `names` whose weights reach `least`, the strongest first."""
        peaks = self.weights.max(axis=0, initial=0.0)
        order = [int(at) for at in np.argsort(-peaks) if peaks[at] >= least]
        return [self.names[at] for at in order if self.names[at] not in names]

    def left_out(self, names: list[str]) -> float:
        """The share of all weights that shapes beside `names` have, root mean square."""
        missing = [at for at, name in enumerate(self.names) if name not in names]
        energy = (self.weights.astype(np.float64) ** 2).sum(axis=0)
        return float(np.sqrt(energy[missing].sum() / max(energy.sum(), 1e-20)))


@dataclass
class Animation:
    """What the library returns for one mesh, in the frame in which it was given.

    `basis`, `displacements` `[T, V, 3]` float32 or a `native_shapes.Clip`, as was asked.
    `largest_mm` is the largest displacement of any vertex in any frame, on a head of human size,
    blinks included; `visibility` is one of `VISIBILITIES`. `shape_weights` is what moves where the
    system makes weights; `heard_emotion` is what was heard, where the motion depends on it;
    `mouth` is how the lips meet, one of `MOUTHS`, `lids` what both eyes' lids do, of `LIDS`;
    `notes` are remarks for the report. A unit of the mesh is `unit_mm` long on a head of human
    size; in frames that are `touching` `[T]` the lips touch.
    """

    largest_mm: float
    visibility: str = "SPEAKS"
    basis: Basis | None = None
    displacements: np.ndarray | None = None
    clip: object = None
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

    `output` names the output that it is made for, `motion` is what that writes, in object units.
    `largest_mm` is the largest displacement of any vertex. Head and eyes lie in `life`; its `way`
    leads from the world to the canonical frame.
    `largest_of` is the largest displacement of each piece of the face, mm, where there are several.
    `shape_weights` are those that a system made itself: named keys get them as they are.
    `heard_emotion` is what was heard in the voice, where the take depends on it.
    `mouth` is how the lips meet, one of `MOUTHS`, `lids` what both eyes' lids do, of `LIDS`;
    `notes` are remarks for the report. No keyframe lies before the scene frame `earliest`, unless
    the sound does. A unit of the object is `unit_mm` long on a head of human size; in frames that
    are `touching` `[T]` the lips touch.
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
    # How far the lips are apart in each frame, mm, where that is known.
    opening: np.ndarray | None = None
    # Finds the keys of curves that are made in Blender, a `sparse.Few`; None for every frame.
    few: object = None

    def scene_frames(self, start_frame: float, scene_fps: float) -> np.ndarray:
        """The scene frames `[T]` of its frames, of which the first lies at `start_frame`."""
        return start_frame + np.arange(self.frame_count) * (scene_fps / self.fps)

    @property
    def frame_count(self) -> int:
        """The number of frames `T`."""
        return self.motion.frame_count


@dataclass(frozen=True)
class ShapesBy:
    """What moves the skin of shapes: a network, or the `field` of the head that is like the face.

    With `in_betweens` ARKit's shapes at weight 0.5 as well, `NAME_half`.
    """

    field: bool = False
    in_betweens: bool = False


NETWORK = ShapesBy()


@dataclass
class Rig:
    """Shapes of one mesh: `names` `[S]`, `vectors` `[S, V, 3]` at strength 1.

    `notes` say of some shapes why they move nothing, or not all that they should.
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

    `keys` `[S]` are names of keys, `weights` `[T, S]`. `vectors` `[S, V, 3]` in object space where
    the keys are to be made, None where they are the artist's own. `visemes` are to be made as well,
    without weights. `left_out` as in `Solved`. Of the artist's keys, `shape_weights` `[T, N]` are
    those of the `shapes` `[N]` that they show, `shown` the one that each key shows most of,
    `factors` by key where it stands at weight 1 of each of its shapes; `missing` are shapes that
    move and that none of them shows, where the system made weights.
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
    """A take as the motion of some points of the skin, and then as values of controls.

    `vertices` `[P]` are numbers of vertices near the 68 landmarks, `frames` `[T, P, 3]` their
    motion in object space, `regions` `[P]` numbers into `controls_plan.REGIONS`. `pairs` `[N, 2]`
    are points of the upper and the lower lip that meet. An object unit is `mm` long, on a head of
    human size. `fitted` is what the controls of a rig do, once they have been tried. Where curves
    hold poses, `pose_frames` `[T]` is for each frame the first frame of its pose.
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

    `ease` frames lead from rest and back to it beside these. `left_out` as in `Solved`. It lies at
    `waits` until it is put at `path`; what lay there before waits at `earlier` until all is
    written. Both are empty where there is no such file.
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
    """A take that lies beside the .blend."""

    files: list[WrittenFile]

    @property
    def frame_count(self):
        return self.files[0].frames
