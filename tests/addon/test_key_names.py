"""Keys of other tools: which shapes they show, and lists made by the artist."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from figures import curves, everything, grid, own_keys, select, shape, stand_in, tone

START = 5
# Some keys of each tool, spelled as the tool spells them.
TOOLS = {
    "ARKit": ["jawOpen", "mouthFunnel", "eyeBlinkLeft"],
    "Oculus": ["viseme_aa", "viseme_PP", "viseme_O"],
    "VRM and VRoid": ["Fcl_MTH_A", "Fcl_MTH_I", "Fcl_MTH_O", "Fcl_EYE_Close"],
    "MMD": ["\u3042", "\u3044", "\u304a", "\u307e\u3070\u305f\u304d"],
    "Character Creator 4": ["V_Open", "V_Explosive", "V_Tight_O", "Eye_Blink_L", "Mouth_Smile_R"],
    "DAZ Genesis": ["eCTRLvAA", "eCTRLvM", "eCTRLvOW", "eCTRLMouthOpen"],
    "Fuse and Mixamo": ["Blink_Left", "MouthOpen", "MouthNarrow_Left", "MouthNarrow_Right"],
    "MetaHuman": ["CTRL_expressions_jawOpen", "CTRL_expressions_eyeBlinkL",
                  "CTRL_expressions_mouthFunnelUL", "CTRL_expressions_mouthFunnelDR"],
    "Ready Player Me": ["mouthOpen", "mouthSmile"],
    "Rhubarb": ["A", "B", "C", "D", "X"],
}  # fmt: skip


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


@pytest.mark.parametrize("tool", TOOLS)
def test_keys_of_a_tool_are_known_by_their_names(addon, tool):
    names = addon("core.key_names")
    keys = ["Basis", "Scar", *TOOLS[tool]]
    preset, pairs = names.guess(keys)
    assert preset == tool
    assert {pair.key for pair in pairs} == set(TOOLS[tool])
    every = {*addon("core.shapes").ARKIT, *addon("core.shapes").VISEMES}
    assert {pair.shape for pair in pairs} <= every
    assert all(0.0 < pair.factor <= 1.0 for pair in pairs)


def test_every_name_of_every_list_is_one_of_a_shape(addon):
    names, shapes = addon("core.key_names"), addon("core.shapes")
    assert names.presets() == sorted(TOOLS, key=names.presets().index)
    for path in sorted(names._FOLDER.glob("*.json")):
        document = json.loads(path.read_text(encoding="utf-8"))
        assert {*document["keys"]} <= {*shapes.ARKIT, *shapes.VISEMES}, path


def test_few_strange_keys_are_no_list_of_a_tool(addon):
    guess = addon("core.key_names").guess
    assert guess(["Basis", "Smile", "A", "Open"]) == ("", [])
    assert guess(["Basis", "jawOpen", "a", "i", "u"])[0] in ("MMD", "VRM and VRoid")


def speaking(tmp_path, names):
    bpy.context.scene.render.fps = 24
    ob = grid()
    own_keys(ob, *names)
    ob.anyface.source, ob.anyface.start_frame = "FILE", START
    ob.anyface.sound_file, ob.anyface.mode = tone(tmp_path / "tone.wav"), "keys"
    for block in ob.data.shape_keys.key_blocks[1:]:
        block.value = 0.0
    return ob


def carrying(stage, ob):
    """Gives the keys the stage's own shapes, so that they can show its motion."""
    rig = stage.rig(np.zeros((len(ob.data.vertices), 3)), None, None, None, None, Silent())
    rest = np.array([vertex.co for vertex in ob.data.vertices], dtype=np.float32)
    for block, vector in zip(ob.data.shape_keys.key_blocks[1:], rig.vectors, strict=False):
        block.points.foreach_set("co", (rest + vector).ravel())


class Silent:
    def check(self, *_):
        """Never cancels."""


def curve(ob, key):
    path = f'key_blocks["{key}"].value'
    action = ob.data.shape_keys.animation_data.action
    fcurve = next(curve for curve in curves(action) if curve.data_path == path)
    return np.array([point.co[1] for point in fcurve.keyframe_points])


def test_a_head_of_another_tool_speaks_without_a_list(stage, tmp_path):
    names = ["MouthOpen", "Blink_Left", "Blink_Right", "Smile_Left", "MouthNarrow_Left",
             "MouthNarrow_Right"]  # fmt: skip
    ob = speaking(tmp_path, names)
    carrying(stage, ob)
    before = everything()
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert "6 shape keys driven" in ob.anyface.report
    assert (curve(ob, "MouthNarrow_Left") == curve(ob, "MouthNarrow_Right")).all()
    assert np.abs(shape(ob, START + 20) - shape(ob, START - 30)).max() > 1e-4
    lids, lips = curve(ob, "Blink_Left"), curve(ob, "MouthNarrow_Left")
    ob.anyface_output.blinks = 0.5
    assert np.abs(curve(ob, "Blink_Left") - 0.5 * lids).max() < 1e-5 and lids.max() > 0.0
    assert (curve(ob, "MouthNarrow_Left") == lips).all()
    bpy.context.scene.frame_set(1)
    bpy.ops.anyface.remove()
    assert everything() == before


def test_a_list_by_hand_has_rows_shares_and_a_file(stage, tmp_path):
    ob = speaking(tmp_path, ["One", "Two", "Three"])
    carrying(stage, ob)
    with pytest.raises(RuntimeError, match=r"press Find Keys or \+"):
        bpy.ops.anyface.generate()
    for name, key in (("jawOpen", "One"), ("mouthFunnel", "Two"), ("jawOpen", "Three")):
        assert bpy.ops.anyface.mapping_add(shape=name, key=key) == {"FINISHED"}
    rows = ob.anyface_output.mapping
    rows[2].factor = 0.25
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    one, three = curve(ob, "One"), curve(ob, "Three")
    assert one.max() > 0.01 and np.abs(three - 0.25 * one).max() < 1e-5
    path = str(tmp_path / "list.json")
    bpy.ops.anyface.mapping_save(filepath=path)
    ob.anyface_output.mapping_index = 1
    assert bpy.ops.anyface.mapping_remove() == {"FINISHED"}
    assert [row.key for row in rows] == ["One", "Three"]
    bpy.ops.anyface.mapping_load(filepath=path)
    assert [(row.shape, row.key, row.factor) for row in rows] == [
        ("jawOpen", "One", 1.0), ("mouthFunnel", "Two", 1.0), ("jawOpen", "Three", 0.25)
    ]  # fmt: skip
    Path(path).write_text('{"version": 1, "keys": {"jawOpen": "Two"}}')
    bpy.ops.anyface.mapping_load(filepath=path)
    assert [(row.shape, row.key, row.factor) for row in rows] == [("jawOpen", "Two", 1.0)]


def test_one_key_takes_several_shapes(stage, addon, tmp_path):
    existing, Pair = addon("scene.shape_keys.artist_keys"), addon("core.key_names").Pair
    pairs = [Pair("eyeBlinkLeft", "Blink", 0.5), Pair("eyeBlinkRight", "Blink", 0.5),
             Pair("jawOpen", "Open")]  # fmt: skip
    shown, factors = existing.factors(pairs)
    assert (shown, existing.names_of(pairs)) == (
        ["eyeBlinkLeft", "eyeBlinkRight", "jawOpen"], ["Blink", "Open"]
    )  # fmt: skip
    assert factors.tolist() == [[0.5, 0.0], [0.5, 0.0], [0.0, 1.0]]


def test_a_list_of_a_tool_is_filled_in_on_demand(stage, tmp_path):
    ob = speaking(tmp_path, ["A", "B", "C", "X"])
    select(ob)
    assert bpy.ops.anyface.mapping_preset(preset="Rhubarb") == {"FINISHED"}
    assert [(row.shape, row.key) for row in ob.anyface_output.mapping] == [
        ("viseme_PP", "A"), ("viseme_SS", "B"), ("viseme_E", "C"), ("viseme_sil", "X")
    ]  # fmt: skip
    assert bpy.ops.anyface.mapping_preset(preset="MetaHuman") == {"CANCELLED"}


def test_where_all_keys_are_driven_both_outputs_name_a_way_on(stage, tmp_path):
    ob = speaking(tmp_path, ["jawOpen", "mouthFunnel"])
    for block in ob.data.shape_keys.key_blocks[1:]:
        block.driver_add("value").driver.expression = "0.5"
    for mode in ("keys", "arkit"):
        ob.anyface.mode = mode
        with pytest.raises(RuntimeError, match="New Keys"):
            bpy.ops.anyface.generate()
    ob.anyface.mode = "basis"
    assert bpy.ops.anyface.generate() == {"FINISHED"}


def test_empty_keys_are_left_out_and_visemes_stand_in(stage, tmp_path):
    arkit = ["jawOpen", "jawLeft", "jawRight", "mouthFunnel", "mouthLeft", "mouthRight"]
    visemes = ["viseme_aa", "viseme_E", "viseme_I", "viseme_O", "viseme_U"]
    ob = speaking(tmp_path, arkit + visemes)
    carrying(stage, ob)
    blocks = ob.data.shape_keys.key_blocks
    for point, at_rest in zip(blocks["mouthRight"].data, blocks[0].data, strict=True):
        point.co = at_rest.co
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    action = ob.data.shape_keys.animation_data.action
    animated = {curve.data_path.split('"')[1] for curve in curves(action)}
    assert animated == {*arkit, *visemes} - {"mouthRight"}
    assert "empty keys, left out: mouthRight" in ob.anyface.report


def test_a_list_of_empty_keys_alone_is_refused(stage, tmp_path):
    ob = speaking(tmp_path, ["jawOpen", "mouthFunnel"])
    blocks = ob.data.shape_keys.key_blocks
    for block in blocks[1:]:
        for point, at_rest in zip(block.data, blocks[0].data, strict=True):
            point.co = at_rest.co
    with pytest.raises(RuntimeError, match="jawOpen, mouthFunnel move nothing"):
        bpy.ops.anyface.generate()
