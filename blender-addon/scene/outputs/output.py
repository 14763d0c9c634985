"""The base class of all ways to write a take, and functions that they share."""

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
    """The settings of an output; the fields of `ui.output_properties.AnyfaceOutput`.

    An empty folder or file means the place beside the .blend. `new_take` keeps the earlier take.
    `mapping` is the artist's list of shapes and keys; if it is empty, keys are found by name. `rig`
    names the armature to animate. `controls` lists `controls.ControlRow`s; if it is empty, controls
    are searched for. Bones named in `left_alone` belong to other settings and stay as they are.
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
    """A way to write a take. The defaults suit shape keys that are named after shapes.

    .blend files and the record of a take store `name`. The menu shows `label` and `help`. The
    methods are listed in the order in which they are called: before the take is made, when it is
    written, and later. Only the plan that `plan` returns runs in the worker thread.
    """

    name = label = help = ""
    # Names of its settings in `Object.anyface_output`.
    options: tuple[str, ...] = ()
    # Its keys are a few vectors that stay within an error bound. Their weights have both signs, and
    # the take has sliders of its own.
    as_basis = False
    # It moves the mesh, so it replaces an earlier take there.
    on_mesh = True
    # Objects beside the face get the same output.
    moves_parts = True
    # It moves the mesh itself. Other outputs animate values by name, which the sample head can give
    # where the mesh has no face.
    needs_face = True
    # It makes files or actions, not shape keys of the mesh.
    in_files = False
    # A stretch of its frames can be redone on the same keys.
    redoes = False
    # Its weights are curves, which can be reduced to few keys.
    has_curves = False
    # Messages: why a written take cannot be changed, and why it cannot wait beside others.
    finished = cannot_wait = ""
    # Formats of `scene.export` that cannot hold its motion, and what to do instead.
    lost_in: Mapping[str, str] = MappingProxyType({})

    def check_object(self, ob) -> None:
        """Raises `AnyfaceError` with the remedy where `ob` cannot be written.

        `ob` is the face or one of its parts.
        """
        guard.check_editable(ob)

    def check(self, ob, settings: OutputSettings) -> None:
        """Raises `AnyfaceError` with the remedy where the face cannot be written.

        It checks the face itself and `settings`.
        """
        self.check_object(ob)

    def why_not(self, ob, settings: OutputSettings) -> str:
        """Why the output cannot work on `ob`; empty where it can."""
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
        """The size of the output, and the work that it adds."""
        raise NotImplementedError

    def plan(self, ob, settings: OutputSettings, fps: float, objects: list[str]) -> Plan:
        """What the worker thread does; call `check` first.

        `fps` are frames of the take per second, `objects` the names of the face's objects.
        """
        return Plan()

    def describe(self, take: Take) -> str:
        """Counts what was written: "31 shape keys"."""
        raise NotImplementedError

    def details(self, take: Take, is_human: bool) -> list[str]:
        """Details that not every artist needs: "exact to 0.10 mm".

        `wording.length` words the lengths.
        """
        return []

    def notes(self, ob, settings: OutputSettings) -> list[str]:
        """Notes for the artist."""
        return []

    def split(self, take: Take, parts: list[Piece]) -> list[tuple[Piece, Take | None]]:
        """The take of each object, the face itself first; None for an object that does not move."""
        return pieces.split(take, parts)

    def settle(self, ob, take: Take, settings: OutputSettings):
        """The take as it will be written.

        Steps that need Blender run here, and it yields between them.
        """
        return take
        yield

    def write(self, ob, take: Take, rest, at, take_record: record.Record) -> None:
        """Writes keys and curves on `ob` and notes them in `take_record`.

        `rest` `[V, 3]` are the positions of the Basis. `at` are the scene frames of
        `curves.with_rest`: of rest, of each frame, and of rest again.
        """
        raise NotImplementedError

    def check_files(self, take: Take) -> None:
        """Raises `AnyfaceError` where the files cannot be played any more."""

    def prepare_files(self, take: Take, start_frame: float, scene_fps: float):
        """Does the slow work in advance, without changing the scene; yields between its steps."""
        return
        yield

    def drop_files(self, take: Take) -> None:
        """Discards everything that `prepare_files` has made but `write_files` has not used."""

    def write_files(self, ob, take: Take, start_frame: float, scene_fps: float) -> None:
        """Connects files or rig actions with `ob` and the objects beside it."""

    def keep(self, ob) -> None:
        """Keeps an earlier take in files or actions, so that the next one can go beside it."""

    def paths(self, take_record: record.Record) -> set[str]:
        """The data paths of all curves of a take."""
        return {curves.value_path(name) for name in (*take_record.keys, *take_record.values)}

    def leave(self, shape_keys) -> None:
        """Resets the settings that `write` has changed on the data-block of the shape keys."""

    def span(self, ob, snapshot) -> tuple[float, float, int]:
        """The scene frame of a written take's first frame, the distance of its frames, their count.

        Only outputs without `redoes` need it.
        """
        start, step = snapshot.source.start_frame, snapshot.scene_fps / snapshot.request.fps
        return start, step, int(np.ceil(strips.duration_s(snapshot.source) * snapshot.request.fps))

    def redo_plan(self, ob, snapshot, first: int, shares: np.ndarray) -> Plan:
        """What the worker thread does to redo frames from `first` on.

        `shares` `[n]` are the weights of the new motion in these frames.
        """
        return Plan()

    def redo_write(self, parts: list, snapshot, take: Take, first: int, at, stretch):
        """Writes the redone frames from `first` on to all `parts`; yields between steps.

        `at` `[n]` are the scene frames at which they lie.
        """
        raise NotImplementedError

    def find(self, ob):
        """The modifier, the actions or the file path of a take of `ob`, or None."""

    def remove(self, ob) -> None:
        """Removes what `find` returns, and deletes a table of ours. Caches stay on disk."""


def draw_list_buttons(layout, stem: str, find: str) -> None:
    """Draws the buttons of an artist's list. The names of their operators begin with `stem`."""
    row = layout.row(align=True)
    row.operator(f"anyface.{stem}_find", text=find)
    row.operator_menu_enum(f"anyface.{stem}_preset", "preset", text="Names")
    row.operator(f"anyface.{stem}_load", text="", icon="FILE_FOLDER")
    row.operator(f"anyface.{stem}_save", text="", icon="FILE_TICK")
    row.operator(f"anyface.{stem}_clear", text="", icon="X")


def write_weights(ob, take_record: record.Record, names: list[str], at, motion) -> None:
    """Notes which keys need curves. `play` later makes the curves from the weights of `motion`."""
    take_record.waiting = names, at, motion


def play(ob, take_record: record.Record):
    """Gives the keys of a take their waiting curves; yields after each curve that it makes.

    Where the artist's keys have no action yet, it plays the prepared curves instead.
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
