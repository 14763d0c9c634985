"""A random user of copies: no action on one character changes another.

`ANYFACE_FUZZ_COPIES` sets the number of rounds; a failure names its last steps and the seed.
"""

import contextlib
import os
from collections import deque
from pathlib import Path

import bpy
import numpy as np
import pytest

from figures import belongings, duplicate, grid, select, stand_in, tone

ROUNDS = int(os.environ.get("ANYFACE_FUZZ_COPIES", "60"))
SEED = int(os.environ.get("ANYFACE_FUZZ_SEED", "14"))
MODES = ("basis", "cache", "arkit", "frames", "csv")
# From this many objects on, no scenes or linked heads are added, and `thin` keeps two faces only.
MOST = 14


class Copier:
    """One random user of a character and its copies, linked, overridden, saved and undone."""

    def __init__(self, folder, stage):
        self.random, self.folder, self.stage = np.random.default_rng(SEED), folder, stage
        self.steps = deque(maxlen=15)
        self.versions = self.acted = 0

    def pick(self, items):
        """One of `items`."""
        items = list(items)
        return items[self.random.integers(len(items))]

    def faces(self):
        """All objects in the scene that may speak."""
        bpy.context.view_layer.update()
        there = [ob for ob in bpy.context.view_layer.objects if ob is not None]
        return [ob for ob in there if ob.type == "MESH" and ob.name.startswith(("Head", "Kopf"))]

    def round(self):
        """Takes one step, then checks that nothing else has changed."""
        step = self.pick((self.generate, self.generate, self.remove, self.copy, self.instance,
                          self.alone, self.scene, self.rename, self.link, self.override, self.undo,
                          self.save_as, self.keep, self.switch, self.adjust,
                          self.thin))  # fmt: skip
        before = _state()
        self.steps.append(step.__name__)
        touched = step()
        lost = [keys.name for keys in bpy.data.shape_keys if keys.user is None]
        assert not lost, (list(self.steps), lost)
        if step != self.undo:
            # Blender does the same after every press.
            bpy.ops.ed.undo_push(message=step.__name__)
        if touched is None:
            return
        after = _state()
        untouched = {number: rows for number, rows in before.items() if number not in touched}
        for number, rows in untouched.items():
            assert number in after, (list(self.steps), number)
            changed = set(rows) ^ set(after[number])
            assert not changed, (list(self.steps), bpy_name(number), list(changed)[:4])

    def act(self, ob, press, **options):
        """Presses a button for one face. Returns all that it may change: the face and its parts."""
        touched = {ob.session_uid, *(row.object.session_uid for row in own_parts(ob))}
        self.steps.append(f"{press} {ob.name} {ob.anyface.mode}")
        select(ob)
        try:
            getattr(bpy.ops.anyface, press)(**options)
            self.acted += 1
        except RuntimeError as error:
            assert "Traceback" not in str(error), (list(self.steps), str(error))
            self.steps.append(str(error).strip()[:100])
        # A copy gets its own parts when it acts for the first time.
        return touched | {row.object.session_uid for row in own_parts(ob)}

    def generate(self):
        ob = self.pick(self.faces())
        ob.anyface.mode = self.pick(MODES)
        ob.anyface_output.new_take = bool(self.random.integers(2))
        self.stage.size = self.random.uniform(0.002, 0.009)
        return self.act(ob, "generate")

    def remove(self):
        return self.act(self.pick(self.faces()), "remove")

    def keep(self):
        return self.act(self.pick(self.faces()), "take_keep")

    def switch(self):
        ob = self.pick(self.faces())
        text = (ob.data.shape_keys or {}).get("anyface_takes", "")
        ids = [word.split('"')[0] for word in text.split('"id": "')[1:]]
        press = self.pick(("take_switch", "take_push_down", "take_delete"))
        return self.act(ob, press, take=self.pick(ids)) if ids else set()

    def adjust(self):
        ob = self.pick(self.faces())
        if not ob.data.shape_keys or ob.library or ob.data.library:
            return set()
        self.steps.append(f"adjust {ob.name}")
        ob.anyface_output.strength = self.random.uniform(0.5, 1.5)
        return {ob.session_uid, *(row.object.session_uid for row in own_parts(ob))}

    def copy(self):
        ob = self.pick(self.local())
        duplicate(ob, *[row.object for row in own_parts(ob)])
        return set()

    def instance(self):
        duplicate(self.pick(self.local()), linked=True)
        return set()

    def alone(self):
        duplicate(self.pick(self.local()))
        return set()

    def local(self):
        """Faces of this file itself, neither linked nor overridden."""
        return [ob for ob in self.faces() if ob.library is None and ob.override_library is None]

    def scene(self):
        if len(bpy.data.objects) < MOST:
            bpy.ops.scene.new(type="FULL_COPY")
        bpy.context.window.scene = self.pick(bpy.data.scenes)
        return set()

    def rename(self):
        ob = self.pick(self.local())
        ob.name = self.pick(["Head", "Kopf", "Head of Zoë"])
        ob.data.name = self.pick(["Head", "Other"])
        return set()

    def link(self):
        files = sorted(self.folder.glob("v*.blend"))
        files = [path for path in files if path != Path(bpy.data.filepath)]
        if not files or len(bpy.data.objects) >= MOST:
            return set()
        with bpy.data.libraries.load(str(self.pick(files)), link=True) as (library, target):
            target.objects = [n for n in library.objects if n.startswith(("Head", "Kopf"))][:1]
        for ob in target.objects:
            with contextlib.suppress(RuntimeError):
                bpy.context.scene.collection.objects.link(ob)
        return set()

    def override(self):
        linked = [ob for ob in self.faces() if ob.library is not None]
        if linked:
            override = self.pick(linked).override_create(remap_local_usages=False)
            if override is not None:
                bpy.context.scene.collection.objects.link(override)
        return set()

    def undo(self):
        if self.random.integers(2) and bpy.ops.ed.undo.poll():
            bpy.ops.ed.undo()
        if self.random.integers(2) and bpy.ops.ed.redo.poll():
            bpy.ops.ed.redo()

    def save_as(self):
        self.versions += 1
        path = str(self.folder / f"v{self.versions}.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path)
        if self.random.integers(2):
            bpy.ops.wm.open_mainfile(filepath=path)
            return None
        return set()

    def thin(self):
        if len(bpy.data.objects) < MOST:
            return set()
        bpy.context.window.scene = bpy.data.scenes[0]
        for scene in bpy.data.scenes[1:]:
            bpy.data.scenes.remove(scene)
        shown = set(bpy.context.scene.objects)
        faces = [ob for ob in self.local() if ob in shown]
        keep = {ob for face in faces[:2] for ob in (face, *(r.object for r in own_parts(face)))}
        for ob in [ob for ob in bpy.data.objects if ob not in keep]:
            bpy.data.objects.remove(ob)
        return None


def own_parts(ob):
    return [row for row in ob.anyface_face.parts if row.object is not None]


def bpy_name(number):
    return next((ob.name for ob in bpy.data.objects if ob.session_uid == number), "gone")


def _state():
    bpy.context.scene.frame_set(1)
    bpy.context.view_layer.update()
    rows_of = {}
    for ob in bpy.data.objects:
        rows = [row for row in belongings(ob) if not row.startswith("part ")]
        rows_of[ob.session_uid] = rows
    return rows_of


def test_nothing_of_another_object_ever_changes(addon, tmp_path):
    stage = stand_in(addon)
    bpy.context.scene.render.fps = 24
    teeth = grid("Teeth_low", 5, 0.05)
    ob = grid("Head", 9)
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "a.wav", seconds=0.5)
    part = ob.anyface_face.parts.add()
    part.object, part.name, part.role = teeth, teeth.name, "jaw"
    hand = Copier(tmp_path, stage)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "v0.blend"))
    for _ in range(ROUNDS):
        if not hand.local():
            pytest.fail(f"no face is left: {list(hand.steps)}")
        hand.round()
    files = len(list(tmp_path.rglob("*.pc2")))
    print(f"{ROUNDS} rounds, {hand.acted} buttons worked, {files} files")
    assert hand.acted > ROUNDS // 10
    assert Path(bpy.data.filepath).parent == tmp_path
