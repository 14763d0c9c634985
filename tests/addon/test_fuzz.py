"""A random user at the panel: any value in any slider, any button at any time, any scene.

`ANYFACE_FUZZ` sets the number of rounds. The seed is fixed, and a failure lists its last steps.
"""

import contextlib
import os
import traceback
from collections import deque
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from conftest import PACKAGE
from faults import WholeStage
from figures import grid, own_keys, stand_in, strip, tone

ROUNDS = int(os.environ.get("ANYFACE_FUZZ", "50"))
SEED = int(os.environ.get("ANYFACE_FUZZ_SEED", "20"))
GROUPS = ("anyface", "anyface_audio", "anyface_face", "anyface_output", "anyface_mouth_chart")
# An error with one of these texts is a deliberate refusal by an operator.
REFUSALS = ("Anyface: ", ".poll()")


class Layout:
    """Stands in for a layout: accepts every call and returns layouts."""

    def __getattr__(self, name):
        if name in ("panel", "panel_prop"):
            return lambda *_, **__: (Layout(), Layout())
        if name == "operator":
            return lambda *_, **__: SimpleNamespace()
        return lambda *_, **__: Layout()


class Context:
    """The context as a sidebar sees it."""

    region = SimpleNamespace(width=300)

    def __getattr__(self, name):
        return getattr(bpy.context, name)


class Hand:
    """One random user; `steps` are the last things it did."""

    def __init__(self, folder, stage):
        self.random = np.random.default_rng(SEED)
        self.folder, self.stage = folder, stage
        self.steps = deque(maxlen=12)
        self.refused = self.finished = 0

    def pick(self, items):
        """One of `items`."""
        items = list(items)
        return items[self.random.integers(len(items))]

    def text(self):
        """A text that somebody might enter: names, paths, nonsense."""
        names = [block.name for block in (*bpy.data.objects, *bpy.data.sounds)]
        files = [str(path) for path in self.folder.iterdir()]
        return self.pick([*names, *files, "", "x", "Ünï / ..", "nowhere.wav", "0", '"]\\'])

    def value(self, prop):
        """A value for an RNA property, inside its range or at its ends."""
        if prop.type == "ENUM":
            items = [item.identifier for item in prop.enum_items]
            return self.pick(items) if items else None
        if prop.type == "BOOLEAN":
            return bool(self.random.integers(2))
        if prop.type == "STRING":
            return self.text()
        if prop.type == "POINTER":
            of_collections = prop.fixed_type.identifier == "Collection"
            there = bpy.data.collections if of_collections else bpy.data.objects
            return self.pick([*there, None])
        low, high = max(prop.hard_min, -1e6), min(prop.hard_max, 1e6)
        middle = self.random.uniform(low, min(high, low + 5.0))
        drawn = self.pick([low, high, middle, middle, prop.default])
        drawn = int(drawn) if prop.type == "INT" else float(drawn)
        return (drawn,) * prop.array_length if getattr(prop, "is_array", False) else drawn

    def set_something(self):
        """Sets one property of one group of one object or of the scene."""
        owner = self.pick([*bpy.data.objects, bpy.context.scene])
        groups = [name for name in GROUPS if hasattr(owner, name)]
        group = getattr(owner, self.pick(groups))
        names = [p.identifier for p in group.bl_rna.properties if not p.is_readonly]
        name = self.pick(names)
        value = self.value(group.bl_rna.properties[name])
        if value is None and group.bl_rna.properties[name].type == "ENUM":
            # A menu whose items are made on the fly may be empty.
            return
        self.steps.append(f"{owner.name}: {name} = {value!r}")
        # The property's poll may refuse an object. Blender then keeps the old value.
        setattr(group, name, value)

    def set_in_list(self):
        """Sets a property of a row of one of the lists on an object."""
        owner = self.pick(bpy.data.objects)
        rows = []
        for group in (getattr(owner, name) for name in GROUPS if hasattr(owner, name)):
            for prop in group.bl_rna.properties:
                if prop.type == "COLLECTION":
                    rows += list(getattr(group, prop.identifier))
        if not rows:
            return
        row = self.pick(rows)
        name = self.pick([p.identifier for p in row.bl_rna.properties if not p.is_readonly])
        value = self.value(row.bl_rna.properties[name])
        self.steps.append(f"{owner.name}: row {name} = {value!r}")
        setattr(row, name, value)

    def press(self):
        """Presses one button, with random values in its properties."""
        self.call(self.pick(dir(bpy.ops.anyface)))

    def call(self, name):
        """Calls one of our operators. It may refuse with a message, but never with a traceback."""
        operator = getattr(bpy.ops.anyface, name)
        values = {}
        for prop in operator.get_rna_type().properties:
            if prop.identifier != "rna_type" and not prop.is_readonly:
                values[prop.identifier] = self.value(prop)
        values = {key: value for key, value in values.items() if value is not None}
        self.steps.append(f"{name}({values})")
        try:
            operator(**values)
            self.finished += 1
        except RuntimeError as error:
            text = str(error)
            assert "Traceback" not in text, f"{text}\n{list(self.steps)}"
            assert any(word in text for word in REFUSALS), f"{text}\n{list(self.steps)}"
            self.refused += 1

    def disturb(self):
        """Does something else to the scene, as an artist would."""
        change = self.pick(CHANGES)
        self.steps.append(change.__name__)
        try:
            change(self)
        except (AttributeError, ReferenceError, RuntimeError, TypeError, ValueError):
            # Blender refuses many things in odd scenes. Only errors that come from our code count.
            assert PACKAGE not in traceback.format_exc(), list(self.steps)

    def look(self):
        """Draws all our panels and menus."""
        bpy.context.window_manager.anyface_more = True
        for name in [n for n in dir(bpy.types) if n.startswith(("ANYFACE_PT_", "ANYFACE_MT_"))]:
            cls, context = getattr(bpy.types, name), Context()
            if hasattr(cls, "poll") and not cls.poll(context):
                continue
            cls.draw(SimpleNamespace(layout=Layout()), context)
            if hasattr(cls, "draw_header_preset"):
                cls.draw_header_preset(SimpleNamespace(layout=Layout()), context)


def in_object_mode():
    """Leaves edit mode, if the active object is in it."""
    active = bpy.context.object
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def switch_mode(hand):
    active = bpy.context.object
    if active is not None and active.visible_get() and active.library is None:
        bpy.ops.object.mode_set(mode=hand.pick(["OBJECT", "EDIT"]) if active.data else "OBJECT")


def choose_active(hand):
    in_object_mode()
    bpy.context.view_layer.objects.active = hand.pick([*bpy.context.view_layer.objects, None])


def select(hand):
    for ob in bpy.context.view_layer.objects:
        ob.select_set(bool(hand.random.integers(2)))
    for one in bpy.context.scene.sequence_editor.strips_all:
        one.select = bool(hand.random.integers(2))


def add_object(hand):
    in_object_mode()
    if len(bpy.data.objects) > 10:
        return
    add = hand.pick([lambda: grid(hand.pick(["Head", "Eye.L", "Teeth_low"]), 5, 0.05), camera])
    add()


def camera():
    bpy.ops.object.camera_add()


def delete_object(hand):
    in_object_mode()
    if len(bpy.data.objects) > 3:
        bpy.data.objects.remove(hand.pick(bpy.data.objects))


def add_collection(hand):
    if len(bpy.data.collections) < 3:
        collection = bpy.data.collections.new("Mouths")
        bpy.context.scene.collection.children.link(collection)
        collection.objects.link(hand.pick(bpy.data.objects))


def rename(hand):
    hand.pick(bpy.data.objects).name = hand.pick(["Head", "Kopf", "x" * 60, "Ünï"])


def add_keys(hand):
    in_object_mode()
    ob = hand.pick(bpy.data.objects)
    if ob.type == "MESH" and ob.data.shape_keys is None:
        own_keys(ob, "Smile", "jawOpen")


def clear_keys(hand):
    in_object_mode()
    ob = hand.pick(bpy.data.objects)
    if ob.type == "MESH":
        ob.shape_key_clear()


def change_mesh(hand):
    in_object_mode()
    ob = hand.pick(bpy.data.objects)
    if ob.type == "MESH" and ob.data.shape_keys is None:
        ob.data.vertices.add(1)


def share_mesh(hand):
    in_object_mode()
    ob, other = hand.pick(bpy.data.objects), hand.pick(bpy.data.objects)
    if ob.type == other.type == "MESH":
        ob.data = other.data


def absolute(hand):
    for shape_keys in bpy.data.shape_keys:
        shape_keys.use_relative = bool(hand.random.integers(2))


def hide(hand):
    ob = hand.pick(bpy.context.view_layer.objects)
    in_object_mode()
    ob.hide_viewport = bool(hand.random.integers(2))


def scale(hand):
    hand.pick(bpy.data.objects).scale.x = hand.pick([1.0, -1.0, 0.0, 100.0])


def keyframe(hand):
    ob = hand.pick(bpy.data.objects)
    name = hand.pick(["intensity", "emotion", "articulation", "asymmetry"])
    ob.keyframe_insert(f"anyface.{name}", frame=int(hand.random.integers(1, 60)))


def drive(hand):
    ob = hand.pick(bpy.data.objects)
    ob.driver_add("anyface.upper_face").driver.expression = hand.pick(["frame / 50", "nonsense("])


def mute(hand):
    one = hand.pick(bpy.context.scene.sequence_editor.strips_all)
    one.mute = not one.mute


def move_strip(hand):
    one = hand.pick(bpy.context.scene.sequence_editor.strips_all)
    one.frame_start = int(hand.random.integers(-50, 100))
    one.frame_offset_start = int(hand.random.integers(0, 20))


def landmarks(hand):
    ob = hand.pick(bpy.data.objects)
    ob["anyface_landmarks"] = hand.pick(["", "[1, 2", "{}", "[]", '{"landmarks": [1]}', 7, "[0]"])


def undo(hand):
    bpy.ops.ed.undo_push(message="fuzz")
    if bpy.ops.ed.undo.poll() and hand.random.integers(2):
        bpy.ops.ed.undo()
    if bpy.ops.ed.redo.poll() and hand.random.integers(2):
        bpy.ops.ed.redo()


def go_to_frame(hand):
    bpy.context.scene.frame_set(int(hand.random.integers(-20, 80)))


def save_and_load(hand):
    in_object_mode()
    path = str(hand.folder / "fuzz.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)


CHANGES = (
    switch_mode,
    choose_active,
    choose_active,
    select,
    add_object,
    delete_object,
    add_collection,
    rename,
    add_keys,
    clear_keys,
    change_mesh,
    share_mesh,
    absolute,
    hide,
    scale,
    keyframe,
    drive,
    mute,
    move_strip,
    landmarks,
    undo,
    go_to_frame,
    save_and_load,
)


@pytest.fixture
def hand(addon, tmp_path, monkeypatch):
    """A user with a head, its teeth and two strips. A stage replaces the library."""
    monkeypatch.chdir(tmp_path)
    # Keep the presets that this user saves away from later tests.
    presets = tmp_path / "presets"
    presets.mkdir()
    monkeypatch.setattr(addon("ui.presets"), "own_folder", lambda create=False: presets)
    stage = stand_in(addon, WholeStage(addon("core.take")))
    sounds = [tone(tmp_path / f"{name}.wav", seconds=0.5) for name in ("a", "b")]
    # Blender 4.2 as a Python module has no sound, so there are no strips then.
    with contextlib.suppress(RuntimeError):
        strip(sounds[0], "Voice", 5, 1)
        strip(sounds[1], "Answer", 30, 1)
    grid("Teeth_low", 9, 0.05)
    ob = grid("Head", 9)
    ob.anyface.source, ob.anyface.sound_file = "FILE", sounds[1]
    return Hand(tmp_path, stage)


def test_no_value_and_no_order_of_buttons_gives_a_traceback(hand, addon):
    for number in range(ROUNDS):
        for _ in range(int(hand.random.integers(1, 4))):
            hand.pick([hand.set_something, hand.set_in_list, hand.disturb, hand.disturb])()
        hand.look()
        (hand.press if hand.random.integers(3) else lambda: hand.call("generate"))()
        hand.stage.calls.clear()
        assert not addon("ui.running").is_running(), (number, list(hand.steps))
    print(f"{ROUNDS} rounds, {hand.finished} buttons worked, {hand.refused} refused in words")
    assert hand.finished > ROUNDS // 20 and hand.refused > 0
