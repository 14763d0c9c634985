"""A .blend of a stranger: wrong types, huge numbers, links in circles and odd names in all that we
store in it. Panels are drawn and buttons pressed; nothing may end in a traceback.

`ANYFACE_FUZZ_HOSTILE` sets the number of rounds.
"""

import json
import os
import time
import tracemalloc
import zlib

import bpy
import numpy as np
import pytest

from figures import grid, own_keys
from test_fuzz import Hand, hand  # noqa: F401

ROUNDS = int(os.environ.get("ANYFACE_FUZZ_HOSTILE", "10"))
# All properties in which we store something, on any kind of data-block.
STORED = (
    "anyface", "anyface_takes", "anyface_shared_mesh", "anyface_shared_action", "anyface_replaced",
    "anyface_rest", "anyface_landmarks", "anyface_normals", "anyface_sound", "anyface_one_sided",
    "anyface_chart_shown", "anyface_csv", "anyface_controls", "anyface_controls_aside",
    "anyface_turned", "anyface_identity",
)  # fmt: skip
BOMB = b"AFS1" + (62).to_bytes(4, "little") + b" " * 62 + zlib.compress(bytes(10**6))
VALUES = (
    0, -1, 2**31 - 1, float("nan"), float("inf"), 1e308, True, "", "x", "null", "5", "[]", "{}",
    "[1]", '"text"', '{"mode": 5, "id": [], "keys": {}}', '{"mode": "named", "keys": [1, null]}',
    '{"landmarks": [1]}', '{"landmarks": {"0": 1}}', "[" * 100_000, "1" * 10_000, "[1e999]",
    '{"path": "/dev/zero", "owner": "", "digest": ""}', "/dev/zero", "//../../../etc/passwd",
    "\ud7ff\n\x1b]0;x\x07", BOMB, b"", [1, 2, 3], [0.5] * 204, {"a": {"b": 1}}, "[NaN]",
)  # fmt: skip
NAMES = (
    'a"]', "a\\", '\\"].value', "../../x", "/etc/passwd", "a\nb", "\x1b]0;x\x07", "'", "%s%n{0}",
    "<script>", "__import__('os')", "\u202egnp", "x" * 63, " ", "CON", "ü" * 31,
)  # fmt: skip


def blocks():
    """Everything that holds custom properties of ours."""
    data = bpy.data
    kinds = data.objects, data.meshes, data.shape_keys, data.actions, data.scenes
    strips = [strip for scene in data.scenes for strip in scene.sequence_editor.strips_all]
    return [block for kind in kinds for block in kind] + strips


def corrupt(user):
    """Puts a wrong value into one of our properties, or into a field of a text that is there."""
    block = user.pick(blocks())
    there = [name for name in [*block.keys()] if name.startswith("anyface")]
    name = user.pick([*STORED, *there, *there, *there])
    own = block if isinstance(block, bpy.types.ID) else 0
    value = user.pick([*VALUES, own, user.pick(bpy.data.objects)])
    if user.random.integers(2) and isinstance(block.get(name), str):
        value = with_wrong_field(user, block[name])
    user.steps.append(f"{block.name}[{name}] = {value!r:.80}")
    try:
        block[name] = value
    except (TypeError, OverflowError, UnicodeEncodeError):
        user.steps.append("Blender refuses it")


def with_wrong_field(user, text):
    """The JSON text with another value in one of its fields."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return "{"
    rows = content if isinstance(content, list) else [content]
    for row in rows:
        if isinstance(row, dict) and row:
            plain = [value for value in VALUES if not isinstance(value, bytes)]
            row[user.pick(row)] = user.pick(plain)
    return json.dumps(content)


def rename(user):
    """Gives an odd name to something that we name in paths and texts."""
    keys = [key for block in bpy.data.shape_keys for key in block.key_blocks]
    groups = [group for ob in bpy.data.objects for group in ob.vertex_groups]
    named = [*bpy.data.objects, *bpy.data.meshes, *bpy.data.sounds, *bpy.data.actions]
    one = user.pick([*named, *keys, *groups])
    user.steps.append(f"rename {one.name!r}")
    one.name = user.pick(NAMES)


def test_what_a_stranger_stored_gives_no_traceback(hand, addon):  # noqa: F811
    own_keys(bpy.data.objects["Head"], 'Smile"]', "jawOpen")
    hand.call("generate")
    slowest = 0.0
    for number in range(ROUNDS):
        start = time.monotonic()
        for _ in range(int(hand.random.integers(1, 4))):
            hand.pick([corrupt, corrupt, rename, Hand.disturb, Hand.set_something])(hand)
        hand.look()
        (hand.press if hand.random.integers(3) else lambda: hand.call("generate"))()
        hand.stage.calls.clear()
        assert not addon("ui.running").is_running(), (number, list(hand.steps))
        slowest = max(slowest, time.monotonic() - start)
    print(
        f"{ROUNDS} rounds, {hand.finished} worked, {hand.refused} refused; slowest {slowest:.1f} s"
    )


def test_no_value_of_a_property_gives_a_traceback(hand):  # noqa: F811
    ob = bpy.data.objects["Head"]
    own_keys(ob, "jawOpen")
    for value in (*VALUES, ob):
        for name in STORED:
            ob[name] = ob.data.shape_keys[name] = value
        hand.look()


def test_a_record_with_fields_of_other_types_is_none(addon):
    record, json_file = addon("scene.shape_keys.record").Record, addon("core.json_file")
    assert json_file.record(record, '{"mode": "named", "later": 1}').mode == "named"
    wrong = ('{"mode": 5}', '{"mode": "a", "keys": "b"}', '{"mode": "a", "values": {"k": "x"}}')
    for text in (*wrong, "[]", "[" * 100_000, "", b"{}", None, 7):
        assert json_file.record(record, text) is None
    assert json_file.records(record, '[{"mode": "a"}, {"mode": 5}]') == []


def test_no_file_but_a_table_is_deleted_with_a_take(addon, tmp_path):
    ob, other = grid("Head", 3), tmp_path / "diary.txt"
    other.write_text("mine")
    csv, identity = addon("scene.outputs.csv"), addon("scene.identity")
    note = csv._Note(str(other), identity.of(ob), csv._digest(other), csv._blend())
    ob[csv.PROPERTY] = json.dumps(vars(note))
    output = next(one for one in addon("scene.outputs").ALL if one.name == "csv")
    output.remove(ob)
    assert other.read_text() == "mine"


def test_packed_sliders_that_grow_without_end_are_refused(addon):
    sliders = addon("core.sliders")
    change = sliders.SliderChange(np.zeros(2), np.ones((2, 5, 3), np.float32))
    packed = sliders.pack({"blinks": change})
    assert sliders.unpack(packed)["blinks"].changes.shape == (2, 5, 3)
    length = int.from_bytes(packed[4:8], "little")
    grown = packed[: 8 + length] + zlib.compress(bytes(10**7))
    other_shape = packed.replace(b"[2, 5, 3]", b"[2, 9, -3]")
    tracemalloc.start()
    for wrong in (grown, packed[:20], packed[:-1], BOMB, other_shape):
        with pytest.raises(ValueError):
            sliders.unpack(wrong)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10**6
