"""Meshes, sounds and a stand-in for the library, for tests of the code around it."""

import importlib
import wave
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np

FPS = 24
# Property groups of the panel. Up to Blender 4.5 they lie among the custom properties.
SETTINGS = {
    "anyface",
    "anyface_audio",
    "anyface_face",
    "anyface_identity",
    "anyface_life_settings",
    "anyface_controls",
    "anyface_list",
    "anyface_output",
}


def grid(name="Head", side=12, scale=0.2):
    """A square mesh of `side` by `side` vertices in the scene, about as large as a head."""
    steps = np.linspace(-scale / 2, scale / 2, side)
    x, z = np.meshgrid(steps, steps)
    vertices = np.column_stack([x.ravel(), np.zeros(side * side), z.ravel()])
    number = np.arange(side * side).reshape(side, side)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    faces = np.stack([corner.ravel() for corner in corners], axis=1)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    ob = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.objects.active = ob
    return ob


def own_keys(ob, *names):
    """Shape keys of an artist: a Basis and one key per name, each moved and set differently."""
    ob.shape_key_add(name="Basis", from_mix=False)
    for number, name in enumerate(names):
        block = ob.shape_key_add(name=name, from_mix=False)
        block.points[number].co.x += 0.01
        block.value = 0.25 + 0.1 * number
    return ob.data.shape_keys


def tone(path, seconds=2.0, rate=16000, silent_until=0.0, hertz=220.0):
    """A WAV file with a tone."""
    time = np.arange(int(seconds * rate)) / rate
    samples = np.sin(2 * np.pi * hertz * time) * 0.5 * (time >= silent_until)
    write_wav(path, samples, rate)
    return str(path)


def babble(path, seconds=2.0, rate=16000):
    """A WAV file with a voice that says a vowel three times a second, which a tone does not."""
    time = np.arange(int(seconds * rate)) / rate
    pitch = 120.0 + 20.0 * np.sin(2 * np.pi * 0.7 * time)
    phase = 2 * np.pi * np.cumsum(pitch) / rate
    opened = 0.5 - 0.5 * np.cos(2 * np.pi * 3.0 * time)
    formants = ((300.0 + 450.0 * opened, 90.0), (2000.0 - 800.0 * opened, 120.0), (2600.0, 180.0))
    samples = np.zeros(len(time))
    for k in range(1, 30):
        gain = sum(1.0 / (1.0 + ((k * pitch - middle) / width) ** 2) for middle, width in formants)
        samples += gain / k**0.5 * np.sin(k * phase)
    samples *= np.clip(1.5 * opened, 0.03, 1.0)
    write_wav(path, 0.5 * samples / np.abs(samples).max(), rate)
    return str(path)


def write_wav(path, samples, rate):
    """Mono 16-bit samples in -1..1."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes((np.clip(samples, -1, 1) * 32767).astype("<i2").tobytes())


def strip(path, name="Voice", frame=11, channel=1):
    """A sound strip in the scene's sequencer."""
    scene = bpy.context.scene
    scene.render.fps = FPS
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    return strips.new_sound(name, str(path), channel, frame)


def motion(frames, vertices, rank=6, size=0.005, seed=0):
    """Smooth displacements `[T, V, 3]` of a known rank, `size` at most."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, 2 * np.pi, frames)
    phases = random.uniform(0, 2 * np.pi, rank)
    weights = np.stack([np.sin((k + 1) * time + phases[k]) / (k + 1) for k in range(rank)], axis=1)
    shapes = random.normal(size=(rank, vertices * 3))
    moved = (weights @ shapes).reshape(frames, vertices, 3).astype(np.float32)
    return moved * (size / np.linalg.norm(moved, axis=2).max())


def basis(take_module, moved):
    """Displacements `[T, V, 3]` as an exact basis with weights in -1..1."""
    frames, vertices, _ = moved.shape
    left, sizes, right = np.linalg.svd(moved.reshape(frames, -1), full_matrices=False)
    nonzero = sizes > sizes[0] * 1e-6
    peak = np.abs(left[:, nonzero]).max(axis=0)
    vectors = (right[nonzero] * (sizes[nonzero] * peak)[:, None]).reshape(-1, vertices, 3)
    return take_module.Basis(vectors, left[:, nonzero] / peak, 0.0)


def sliders(module, names, weights, knots=(0.0, 1.5)):
    """Sliders that subtract `weights` `[T, K]`, with rolled columns, below 1 and add them above 1.

    A slider with "blinks" in its name has only the lower knot and acts only in frames 10 to 14.
    """
    changes_of = {}
    for number, name in enumerate(names):
        places = knots[:1] if "blinks" in name else knots
        turned = np.roll(weights, number + 1, axis=1)
        changes = np.stack([(place - 1.0) * turned for place in places]).astype(np.float32)
        if "blinks" in name:
            changes[:, :10], changes[:, 15:] = 0.0, 0.0
        changes_of[name] = module.SliderChange(np.array(places), changes)
    return changes_of


class Stage:
    """Stands in for the native engine where only reading and writing are tested.

    Moves every vertex by `motion`, and remembers the arguments of its calls.
    """

    def __init__(self, take_module, decode=None, size=0.005, rank=6):
        self.take_module, self._decode = take_module, decode
        self.size, self.rank = size, rank
        self.calls, self.searches = [], []
        # Names of the sliders that its takes have.
        self.sliders = ()
        # The folder of its models. None means the built-in ones.
        self.models = None

    def animate(self, positions, triangles, points, numbers, sound, request, progress):
        """Displacements of `motion`, as a basis if the request allows an error."""
        self.calls.append((positions, triangles, points, numbers, sound, request))
        progress.check("deform", 0.5)
        frames = int(np.ceil(sound.duration_s * request.fps))
        moved = motion(frames, len(positions), self.rank, self.size)
        animation = self.take_module.Animation(self.size * 1000.0)
        if animation.largest_mm < 0.05:
            animation.visibility = "NOTHING"
        if request.error_mm is None:
            animation.displacements = moved
        else:
            animation.basis = basis(self.take_module, moved)
            package = self.take_module.__package__
            module = importlib.import_module(f"{package}.sliders")
            animation.basis.sliders = sliders(module, self.sliders, animation.basis.weights)
        return animation

    def animate_stretch(self, positions, *arguments, rows):
        """The frames `rows` of `motion` with the seed of the request."""
        *_, sound, request, _progress = arguments
        self.calls.append((positions, *arguments[:-1]))
        frames = int(np.ceil(sound.duration_s * request.fps))
        moved = motion(frames, len(positions), self.rank, self.size, request.fields["seed"])
        animation = self.take_module.Animation(self.size * 1000.0)
        animation.displacements = moved[rows.start : rows.stop]
        return animation

    def listen(self, sound):
        """Two intervals in seconds."""
        return np.array([[0.30, 0.38], [1.02, 1.06]])

    def listen_to_words(self, sound, text):
        """The same intervals, and the words of the text, each 0.25 s long, from 0.25 s on."""
        words = [(0.25 * at, 0.25 * at + 0.25, word) for at, word in enumerate(text.split(), 1)]
        return self.listen(sound), words

    def read_sounds(self, path, fps):
        """One interval in seconds."""
        return np.array([[0.5, 0.75]])

    def closes_lips(self, label):
        """True for the three sounds that every list has, and for their common mouth shape."""
        return label in ("p", "b", "m", "MBP")

    def find(self, positions, triangles, landmarks, numbers, fixed, roles, progress):
        """The first 68 vertices or the given landmarks. Those beside fixed ones go half as far."""
        self.searches.append((positions, landmarks, numbers, fixed, roles))
        if len(positions) < 68:
            errors = importlib.import_module(f"{self.take_module.__package__}.errors")
            raise errors.AnyfaceError("face", "no face was found")
        places = positions[:68] if landmarks is None else np.array(landmarks)
        if numbers is not None:
            places = positions[numbers]
        places = places.astype(np.float64)
        for number, place in fixed.items():
            moved = np.asarray(place) - places[number]
            for beside in {number - 1, number + 1} & set(range(68)) - set(fixed):
                places[beside] += moved / 2
            places[number] = place
        sure = np.full(68, 0.97, dtype=np.float32)
        sure[list(fixed)] = 1.0
        owners = np.zeros(len(positions), dtype=np.uint32)
        if roles is not None:
            owners = np.asarray(roles.object_of_vertex)
        parts = np.where(np.arange(owners.max() + 1) == 0, 0, 1)
        result = self.take_module.Found
        return result(places, np.arange(68), sure, "slit", parts, owners)

    def rig(self, positions, triangles, points, numbers, roles, progress, by=None):
        """The first ARKit shapes are the motion's, then their negatives; the others stay still."""
        progress.check("rig")
        import importlib

        names = importlib.import_module(self.take_module.__name__.replace("take", "shapes"))
        every = [*names.ARKIT, *names.VISEMES]
        vectors = np.zeros((len(every), len(positions), 3), dtype=np.float32)
        moved = motion(24, len(positions), self.rank, self.size).reshape(24, -1)
        shapes = np.linalg.svd(moved, full_matrices=False)[2][: self.rank] * 0.1
        shapes = shapes.reshape(self.rank, -1, 3)
        vectors[: self.rank], vectors[self.rank : 2 * self.rank] = shapes, -shapes
        vectors[52:] = shapes[0]
        return self.take_module.Rig(every, vectors)

    def solve(self, names, vectors, _lips, moved, progress, path="", fps=0.0):
        """Weights from 0 to 1 by projected descent. With `path` it also writes a plain table."""
        progress.check("solve")
        shapes = vectors.reshape(len(vectors), -1).astype(np.float64)
        right, gram = moved.reshape(len(moved), -1) @ shapes.T, shapes @ shapes.T
        step = 1.0 / max(np.linalg.norm(gram, 2), 1e-12)
        weights = np.zeros(right.shape)
        for _ in range(2000):
            weights = np.clip(weights - step * (weights @ gram - right), 0.0, 1.0)
        left = np.linalg.norm(moved.reshape(len(moved), -1) - weights @ shapes)
        if path:
            rows = [",".join(names), *(",".join(f"{x:.6f}" for x in row) for row in weights)]
            with open(path, "w", encoding="utf-8") as file:
                file.write("\n".join(rows))
        share = float(left / max(np.linalg.norm(moved), 1e-12))
        return self.take_module.Solved(weights.astype(np.float32), share)

    def decode(self, path):
        """Reads 16-bit mono WAV."""
        with wave.open(path, "rb") as file:
            rate = file.getframerate()
            data = np.frombuffer(file.readframes(file.getnframes()), dtype="<i2")
        return (data / 32768.0).astype(np.float32), float(rate), ""

    def is_damaged(self, path):
        """False: a file that it cannot read counts as no sound at all."""
        return False

    def few_keys(self, weights, vectors, tolerance, touching, progress):
        """Returns None: every frame has a key."""

    def few_keys_each(self, values, limits):
        """Returns None for each curve: every frame has a key."""
        return [None] * len(limits)

    def close(self):
        """Has nothing to free."""


def stand_in(addon, engine=None):
    """Replaces the engine of every system by `engine`, or by a new stage."""
    engine = engine or Stage(addon("core.take"))
    names = [system.name for system in addon("core.systems").known()]
    keys = [(name, None, 0) for name in ("", *names)]
    addon("ui.running")._engines.update(dict.fromkeys(keys, engine))
    return engine


def everything():
    """All data-blocks, shape keys, values, curves, drivers and custom properties, as text rows."""
    rows = []
    for kind in ("objects", "meshes", "shape_keys", "actions", "sounds", "scenes", "texts"):
        # The text about a fault stays, even if everything else is undone.
        for block in [one for one in getattr(bpy.data, kind) if one.name != "Anyface Fault"]:
            names = sorted(
                set(block.keys()) - (SETTINGS if kind in ("objects", "scenes") else set())
            )
            rows.append(f"{kind} {block.name} users={block.users} props={names}")
    for shape_keys in bpy.data.shape_keys:
        rows.append(f"{shape_keys.name} relative={shape_keys.use_relative}")
        for block in shape_keys.key_blocks:
            points = np.empty(len(block.points) * 3, dtype=np.float32)
            block.points.foreach_get("co", points)
            rows.append(
                f"  {block.name} {block.value:.5f} {block.slider_min} {block.slider_max} "
                f"{block.mute} {block.relative_key.name} {hash(points.tobytes())}"
            )
        rows += animation_rows(shape_keys.animation_data)
    for mesh in bpy.data.meshes:
        points = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
        mesh.vertices.foreach_get("co", points)
        rows.append(f"{mesh.name} {hash(points.tobytes())}")
    for ob in bpy.data.objects:
        data = getattr(ob.data, "name", None)
        rows.append(f"{ob.name} data={data} key={ob.active_shape_key_index} {ob.mode}")
    return rows


def animation_rows(animation):
    """Action, slot, curves, drivers and tracks of animation data as text rows."""
    if animation is None:
        return ["  no animation data"]
    action = animation.action
    rows = [f"  action {action.name if action else None}"]
    rows.append(f"  slot {getattr(getattr(animation, 'action_slot', None), 'identifier', None)}")
    rows += [f"  driver {driver.data_path}" for driver in animation.drivers]
    rows += [f"  track {track.name}" for track in animation.nla_tracks]
    for curve in curves(action):
        keys = [tuple(round(value, 5) for value in point.co) for point in curve.keyframe_points]
        rows.append(f"  curve {curve.data_path} {keys}")
    return rows


def curves(action):
    """Every curve of an action, in every version of Blender."""
    if action is None:
        return []
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]


def film(ob, frames):
    """Positions `[N, V, 3]` of the evaluated mesh at scene frames."""
    return np.stack([shape(ob, frame) for frame in frames])


def shape(ob, frame):
    """Positions `[V, 3]` of the evaluated mesh of `ob` at a scene frame, object space."""
    scene = bpy.context.scene
    whole = int(np.floor(frame))
    scene.frame_set(whole, subframe=float(frame - whole))
    mesh = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def select(*objects):
    """Selects only these objects and makes the first one active."""
    for ob in bpy.context.view_layer.objects:
        ob.select_set(ob in objects)
    bpy.context.view_layer.objects.active = objects[0]


def duplicate(*objects, linked=False):
    """Duplicates as Shift-D does, or as Alt-D if `linked`. Returns the copies in the same order."""
    names = [ob.name for ob in objects]
    there = set(bpy.data.objects)
    select(*objects)
    assert bpy.ops.object.duplicate(linked=linked) == {"FINISHED"}
    fresh = [ob for ob in bpy.data.objects if ob not in there]
    return [next(ob for ob in fresh if ob.name.startswith(name.split(".")[0])) for name in names]


def link_from_library(name, folder):
    """Saves the open file as a library and links its object `name` into an empty file."""
    path = str(folder / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, names):
        names.objects = [name]
    ob = bpy.data.objects[name]
    bpy.context.scene.collection.objects.link(ob)
    return ob


def window(ob=None):
    """A window's context with `ob`, or with a new head. Its window manager counts the timers."""
    manager = SimpleNamespace(windows=[], timers=0, modal_handler_add=lambda _operator: None)

    def add(_seconds, window):
        manager.timers += 1
        return object()

    def remove(_timer):
        manager.timers -= 1

    manager.event_timer_add, manager.event_timer_remove = add, remove
    return SimpleNamespace(
        window_manager=manager, window=None, scene=bpy.context.scene, object=ob or grid()
    )


def belongings(ob):
    """All that `ob` shows and keeps, as text without its name: keys, curves, takes, files."""
    rows = [f"delta {tuple(ob.delta_rotation_euler)} {tuple(ob.delta_location)}"]
    rows += [f"part {part.object}" for part in ob.anyface_face.parts]
    rows += _owned_curves(ob.animation_data)
    for modifier in ob.modifiers:
        rows.append(f"modifier {modifier.type} {modifier.name}")
        if modifier.type == "MESH_CACHE":
            rows.append(_file(modifier.filepath))
    outputs = importlib.import_module("bl_ext.user_default.anyface.scene.outputs")
    # A copied object also has the original's note of a table, but not the table itself.
    table = outputs.of("csv").find(ob)
    if table is not None:
        rows.append(_file(table))
    if ob.type == "MESH":
        rows += _owned_keys(ob.data)
    return rows


def _owned_keys(mesh):
    points = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    rows = [f"mesh {hash(points.tobytes())}"]
    if mesh.shape_keys is None:
        return rows
    action = getattr(mesh.shape_keys.animation_data, "action", None)
    animated = {curve.data_path for curve in curves(action)}
    for block in mesh.shape_keys.key_blocks:
        points = np.empty(len(block.points) * 3, dtype=np.float32)
        block.points.foreach_get("co", points)
        value = "" if block.path_from_id("value") in animated else f"{block.value:.5f}"
        rows.append(f"key {block.name} {value} {block.mute} {hash(points.tobytes())}")
    for name in sorted(mesh.shape_keys.keys()):
        stored = mesh.shape_keys[name]
        if isinstance(stored, bpy.types.Action):
            rows += [f"waits {row}" for row in _curve_rows(stored)]
    return rows + _owned_curves(mesh.shape_keys.animation_data)


def _owned_curves(animation):
    if animation is None:
        return []
    rows = _curve_rows(animation.action)
    for track in animation.nla_tracks:
        for strip in track.strips:
            rows += [f"strip {strip.name}", *_curve_rows(strip.action)]
    return rows


def _curve_rows(action):
    return [
        f"curve {c.data_path} {[tuple(round(x, 5) for x in p.co) for p in c.keyframe_points]}"
        for c in curves(action)
    ]


def _file(path):
    path = Path(bpy.path.abspath(str(path)))
    return f"{path.name} {hash(path.read_bytes()) if path.is_file() else 'gone'}"
