"""Raises an exception at any step of a job: wherever a function of the extension is called."""

import errno
import importlib
import sys
import threading
import time
import types
from collections import Counter
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace

import bpy
import numpy as np

import figures
from figures import Stage

TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
# If a job takes longer than this, it hangs, and its test fails.
LIMIT_S = 20.0
ERRORS = (
    lambda: MemoryError(),
    lambda: RecursionError("maximum recursion depth exceeded"),
    lambda: KeyboardInterrupt(),
    lambda: BrokenProcessPool("a child process terminated abruptly"),
    lambda: SystemExit(3),
    lambda: ReferenceError("StructRNA of type Object has been removed"),
    lambda: FileNotFoundError(errno.ENOENT, "No such file or directory", "/gone/voice.wav"),
    lambda: OSError(errno.ENOSPC, "No space left on device", "/full/head.pc2"),
    lambda: UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"),
    lambda: RuntimeError("Error: \udcff half a letter"),
    lambda: ZeroDivisionError("division by zero"),
    lambda: KeyError("co"),
)
# Functions that get no faults: they catch exceptions, or Blender calls them before a job exists.
_NET = {
    "errors.py": None,
    "way_back.py": None,
    "running.py": {"finish", "is_running", "_on_undo", "_on_load"},
    "job.py": {"__init__", "start", "done", "_run", "discard", "result", "cancelled", "cancel"},
    "operators.py": {"modal", "invoke", "execute", "_break", "_end", "fail", "cancel"},
    "in_view.py": {"invoke", "modal", "_break", "_end", "cancel"},
    "target.py": None,
    # Blender reads the property, and ends where reading raises SystemExit.
    "output_properties.py": {"read_take"},
}
_HANDLERS = {"_on_frame", "_on_end", "_on_save", "_on_load", "_on_undo"}


class Fault:
    """Raises `error` at the `number`th call of one function. Without a function it counts calls."""

    def __init__(self, folder, code=None, number=1, error=None):
        self.calls = Counter()
        self._folder, self._code, self._left, self._error = str(folder), code, number, error

    def __enter__(self):
        threading.setprofile(self)
        sys.setprofile(self)
        return self

    def __exit__(self, *_):
        sys.setprofile(None)
        threading.setprofile(None)

    def __call__(self, frame, event, _argument):
        """Python calls this at each call of a function."""
        if event != "call":
            return
        code = frame.f_code
        if self._code is None:
            if code.co_filename.startswith(self._folder) and not _in_handler(frame):
                self.calls[code] += 1
        elif code is self._code and not _in_handler(frame):
            self._left -= 1
            if self._left == 0:
                raise self._error


def _in_handler(frame) -> bool:
    """Whether the call comes from a handler that Blender runs by itself, so no job waits for it."""
    while frame is not None:
        if frame.f_code.co_name in _HANDLERS:
            return True
        frame = frame.f_back
    return False


def steps_of(calls: Counter, folder) -> list:
    """The functions that a job called and that may fail, and how often it called each."""
    return [(code, n) for code, n in calls.items() if _is_step(code)]


def _is_step(code) -> bool:
    name = code.co_filename.replace("\\", "/").rpartition("/")[2]
    if name in _NET and (_NET[name] is None or code.co_name in _NET[name]):
        return False
    return code.co_name not in _HANDLERS and not code.co_name.startswith("<")


def without_blender(cls, **options):
    """An operator as a plain object, because only Blender can make real ones.

    Its reports are collected in `messages`.
    """
    namespace = {name: value for name, value in vars(cls).items() if name not in _SLOTS}
    bases = tuple(base for base in cls.__bases__ if base is not bpy.types.Operator)
    plain_class = type(cls.__name__, bases, namespace)
    for name, value in namespace.items():
        function = value.__func__ if isinstance(value, classmethod) else value
        if isinstance(function, types.FunctionType):
            method = _bound_to(function, plain_class)
            setattr(
                plain_class, name, classmethod(method) if isinstance(value, classmethod) else method
            )
    operator = plain_class()
    operator.messages = []
    operator.report = lambda kinds, text: operator.messages.append((*kinds, _checked(text)))
    for name, value in options.items():
        setattr(operator, name, value)
    return operator


_SLOTS = {"__dict__", "__weakref__", "__slots__", "bl_rna", "__annotations__"}


def _bound_to(function, cls):
    """A copy of the function whose `super()` is that of `cls`."""
    names = function.__code__.co_freevars
    cells = [
        types.CellType(cls) if name == "__class__" else cell
        for name, cell in zip(names, function.__closure__ or (), strict=True)
    ]
    parts = function.__code__, function.__globals__, function.__name__, function.__defaults__
    bound = types.FunctionType(*parts, tuple(cells))
    bound.__kwdefaults__ = function.__kwdefaults__
    return bound


def _checked(text: str) -> str:
    # Blender encodes its messages too.
    text.encode("utf-8")
    return text


def press(operator, ob) -> tuple[str, object]:
    """Runs an operator to its end, as in a window. Returns its result and the window manager."""
    context = figures.window(ob)
    bpy.context.view_layer.objects.active = ob
    result, ends = operator.invoke(context, TIMER), time.monotonic() + LIMIT_S
    while result in ({"RUNNING_MODAL"}, {"PASS_THROUGH"}):
        assert time.monotonic() < ends, "the job never ends"
        time.sleep(0.001)
        result = operator.modal(context, TIMER)
    # The thread of a cancelled job removes its files once it notices the cancel.
    for thread in threading.enumerate():
        if thread.name == "anyface":
            thread.join(LIMIT_S)
    (word,) = result
    return word, context.window_manager


class LiveFace:
    """Stands in for a face that follows its sound, or a microphone if it `listens`."""

    name, is_lost, is_recording, delay_s = "Desk", False, False, 0.2

    def __init__(self, count, listens=False):
        self._count, self.listens = count, listens

    def feel(self, strengths):
        """Ignores the strengths of emotions."""

    def record(self, frame):
        """Starts to record and keeps the frame."""
        self.is_recording, self._frame = True, frame

    def drop_recording(self):
        """Stops recording."""
        self.is_recording = False

    def recording(self):
        """A second of silence, and the frame."""
        sound = SimpleNamespace(samples=np.zeros(16000, np.float32), rate_hz=16000.0)
        return sound, self._frame

    def at(self, seconds):
        """The same displacement for all vertices."""
        return np.full((self._count, 3), 0.001, dtype=np.float32)

    def close(self):
        """Has nothing to free."""


class WholeStage(Stage):
    """A stage that can do everything the panel asks for."""

    def live(self, positions, *_):
        """A face that follows."""
        return LiveFace(len(positions))

    def live_microphone(self, positions, *_):
        """A face that follows a microphone."""
        return LiveFace(len(positions), listens=True)

    def open_mouth(self, positions, triangles, *_):
        """The mesh unchanged, as if its lips could part already."""
        package = self.take_module
        vertices, faces = np.arange(len(positions)), np.arange(len(triangles))
        corners = np.tile(np.eye(3), (len(faces), 1, 1))
        return package.OpenedFace(
            positions=np.array(positions),
            triangles=np.array(triangles),
            landmarks=np.array(positions[:68], dtype=np.float64),
            landmark_vertices=np.arange(68),
            vertex_sources=np.tile(vertices[:, None], (1, 3)),
            vertex_shares=np.tile([1.0, 0.0, 0.0], (len(vertices), 1)),
            triangle_sources=faces,
            corner_shares=corners,
            first_lining_triangle=len(faces),
            first_inside_triangle=len(faces),
        )

    def open_eyes(self, positions, triangles, *marks_and_progress):
        """The mesh unchanged, as if its eyes could blink already."""
        return self.open_mouth(positions, triangles, *marks_and_progress)

    def head_like(self, positions, triangles, *_):
        """Returns the face itself as its head."""
        module = importlib.import_module(f"{self.take_module.__package__}.native_head")
        head = module.MadeHead(
            np.array(positions)[:, [0, 2, 1]], np.array(triangles), np.arange(68), len(positions)
        )
        return head, 0.5, 1.0

    def chart(self, *arguments, **_):
        """Lips that close once."""
        closed = arguments[7] == "rhubarb"
        rest, lips = ("X", "A") if closed else ("rest", "MBP")
        return [(0.0, 0.2, rest), (0.2, 0.3, lips), (0.3, 0.5, rest)]

    def mask(self, positions, *_):
        """A mask of one half at every vertex."""
        return np.full(len(positions), 0.5, dtype=np.float32)

    def animate(self, *arguments):
        """The motion of `Stage`, with a rotated head."""
        animation = super().animate(*arguments)
        frames = int(np.ceil(arguments[4].duration_s * arguments[5].fps))
        way = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], dtype=np.float32)
        head = np.tile([0.05, 0.03, 0.02], (frames, 1))
        animation.life = self.take_module.Life(head, np.zeros((frames, 2, 2)), way)
        return animation
