"""What all ways to write a take have in common."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import bpy
import numpy as np

from ...core.errors import AnyfaceError
from ...core.estimate import Asked, Cost
from ...core.key_names import Pair
from ...core.plan import Plan
from ...core.take import Piece, Take
from ..animation import curves
from ..face import pieces
from ..shape_keys import guard, record
from ..sound import strips

PREFIX = "Anyface"


@dataclass
class OutputSettings:
    """What an output may be told; the fields of `ui.output_properties.AnyfaceOutput`.

    An empty folder or file takes the place beside the .blend. `new_take` keeps the earlier take.
    `mapping` is the artist's list of shapes and keys; empty, keys are found by name. `rig` names
    the armature whose controls move, `controls` are `controls.ControlRow`s; empty, they are found.
    Bones of the names `left_alone` are worked by others.
    """

    cache_folder: str = ""
    csv_file: str = ""
    visemes: bool = False
    new_take: bool = False
    mapping: list[Pair] = field(default_factory=list)
    rig: str = ""
    controls: list = field(default_factory=list)
    left_alone: list[str] = field(default_factory=list)


class Output:
    """A way to write a take; here what holds for shape keys that are named after shapes.

    `name` is kept in .blend files, and in the record of a take; `label` and `help` are the menu's.
    The methods stand in the order in which they are called: before the take is made, when it is
    written, and later. Only what `plan` returns runs in the worker thread.
    """

    name = label = help = ""
    # Names of its settings in `Object.anyface_output`.
    options: tuple[str, ...] = ()
    # Few vectors within an error bound, whose weights have both signs and sliders of their own.
    as_basis = False
    # The mesh moves, and an earlier take on it goes.
    on_mesh = True
    # Objects beside the face follow in the same way.
    moves_parts = True
    # What it makes lies elsewhere than in shape keys of the mesh.
    in_files = False
    # Its keys can show another motion for some of the frames.
    redoes = False
    # Its weights are curves, which may have few keys.
    has_curves = False
    # Why a written take cannot be changed, or cannot wait beside others, in words.
    finished = cannot_wait = ""
    # Formats of `scene.export` that cannot hold its motion, and what to do instead.
    lost_in: Mapping[str, str] = MappingProxyType({})

    def check_object(self, ob) -> None:
        """Raises `AnyfaceError` with the remedy where `ob`, or one beside it, cannot be written."""
        guard.check_editable(ob)

    def check(self, ob, settings: OutputSettings) -> None:
        """The same for the face itself, with what the output was told."""
        self.check_object(ob)

    def why_not(self, ob, settings: OutputSettings) -> str:
        """Why it cannot work on `ob`, in words; empty where it can."""
        try:
            self.check(ob, settings)
        except AnyfaceError as error:
            return str(error)
        return ""

    def draw(self, layout, ob) -> None:
        """Draws its options."""
        for name in self.options:
            layout.prop(ob.anyface_output, name)

    def cost(self, workload: Asked) -> Cost:
        """How large it gets and what it adds to the work."""
        raise NotImplementedError

    def plan(self, ob, settings: OutputSettings, fps: float, objects: list[str]) -> Plan:
        """What the worker thread does; `check` has found nothing.

        `fps` are frames of the take per second, `objects` the names of the face's objects.
        """
        return Plan()

    def describe(self, take: Take) -> str:
        """What was made, as counts: "31 shape keys"."""
        raise NotImplementedError

    def details(self, take: Take, is_human: bool) -> list[str]:
        """What only some want to know: "exact to 0.10 mm"; lengths as `wording.length` has them."""
        return []

    def notes(self, ob, settings: OutputSettings) -> list[str]:
        """What the artist should know besides."""
        return []

    def split(self, take: Take, parts: list[Piece]) -> list[tuple[Piece, Take | None]]:
        """What each object of a face gets, the face itself first; None where one does not move."""
        return pieces.split(take, parts)

    def settle(self, ob, take: Take, settings: OutputSettings):
        """The take as it is written, once what needs Blender is done: in steps, yields between."""
        return take
        yield

    def write(self, ob, take: Take, rest, at, take_record: record.Record) -> None:
        """Writes keys and curves on `ob` and notes them in `taken`.

        `rest` `[V, 3]` are the positions of the Basis, `at` the scene frames of `curves.with_rest`:
        of rest, of each frame, and of rest again.
        """
        raise NotImplementedError

    def check_files(self, take: Take) -> None:
        """Raises `AnyfaceError` where files cannot be played any more."""

    def prepare_files(self, take: Take, start_frame: float, scene_fps: float):
        """Makes beforehand what takes long, and changes nothing; yields between its steps."""
        return
        yield

    def drop_files(self, take: Take) -> None:
        """Takes back what `prepare_files` has made and nobody has used."""

    def write_files(self, ob, take: Take, start_frame: float, scene_fps: float) -> None:
        """Connects what lies elsewhere with `ob` and the objects beside it: files, a rig."""

    def keep(self, ob) -> None:
        """Lets go of an earlier take that lies elsewhere, where the next one is to go beside it."""

    def paths(self, take_record: record.Record) -> set[str]:
        """The data paths of all curves of a take."""
        return {curves.value_path(name) for name in (*take_record.keys, *take_record.values)}

    def leave(self, shape_keys) -> None:
        """Undoes what `write` has set on the shape keys as a whole."""

    def span(self, ob, snapshot) -> tuple[float, float, int]:
        """Where the frames of a written take lie: the scene frame of the first, how far they are
        apart, and how many; for outputs that do not `redoes`."""
        start, step = snapshot.source.start_frame, snapshot.scene_fps / snapshot.request.fps
        return start, step, int(np.ceil(strips.duration_s(snapshot.source) * snapshot.request.fps))

    def redo_plan(self, ob, snapshot, first: int, shares: np.ndarray) -> Plan:
        """What the worker thread does with frames from `first` on that go to new motion by `shares`
        `[n]`."""
        return Plan()

    def redo_write(self, parts: list, snapshot, take: Take, first: int, at, stretch):
        """Writes frames from `first` on, at scene frames `at` `[n]`, on the face and the objects
        beside it; yields between steps."""
        raise NotImplementedError

    def find(self, ob):
        """What plays or names a file of `ob`; None where there is none."""

    def remove(self, ob) -> None:
        """Takes away what `find` finds, and the files behind it."""


def draw_list_buttons(layout, stem: str, find: str) -> None:
    """Draws the buttons of an artist's list, whose operators begin with `stem`."""
    row = layout.row(align=True)
    row.operator(f"anyface.{stem}_find", text=find)
    row.operator_menu_enum(f"anyface.{stem}_preset", "preset", text="Names")
    row.operator(f"anyface.{stem}_load", text="", icon="FILE_FOLDER")
    row.operator(f"anyface.{stem}_save", text="", icon="FILE_TICK")
    row.operator(f"anyface.{stem}_clear", text="", icon="X")


def write_weights(ob, take_record: record.Record, names: list[str], at, motion) -> None:
    """Notes the curves of the values of keys, which `play` makes of the weights of a motion, from
    rest and back to it."""
    take_record.waiting = names, at, motion


def play(ob, take_record: record.Record):
    """Gives the keys of a take the curves that it waits for; yields between those that it makes.

    Those that were prepared are used, where no action of the artist's has to hold them.
    """
    names, at, motion = take_record.waiting
    take_record.waiting = None
    shape_keys = ob.data.shape_keys
    if take_record.prepared is not None and shape_keys.animation_data is None:
        shape_keys.animation_data_create()
        take_record.made_animation_data = True
    if take_record.prepared is not None and take_record.prepared.play(shape_keys, names):
        take_record.made_action = True
        return
    every = curves.keys_of(motion)
    for name, column, keys in zip(names, motion.weights.T, every, strict=True):
        bag = curves.key_channels(ob, take_record)
        values, lead = curves.from_rest(column, at), curves.rests_before(at, len(column))
        curves.write_take(bag, curves.value_path(name), at, values, keys, lead=lead)
        yield


def check_place(path: str) -> None:
    """Raises `AnyfaceError("file")` for a path beside a .blend that is not saved yet."""
    if not bpy.data.filepath and (not path or path.startswith("//")):
        text = "the .blend has no place yet: save it first, or choose a path"
        raise AnyfaceError("file", text, ("save",))
