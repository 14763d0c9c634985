"""Errors offer a fix: a button below the report, and one press fixes the error."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from figures import grid, own_keys, shape, stand_in, strip, tone
from test_first_minutes import heard
from test_panels import Paper


@pytest.fixture(autouse=True)
def stage(addon):
    """A `Stage` that replaces the engine."""
    return stand_in(addon)


def offered(addon, ob):
    """The texts of the buttons below the report."""
    words = []
    addon("ui.mending").draw(Paper(words), ob, 4000)
    return [text for text, _ in words if text]


def fails(words):
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.anyface.generate()


def mends(name):
    assert bpy.ops.anyface.mend(name=name) == {"FINISHED"}
    ob = bpy.context.object
    assert not ob.anyface.report and not ob.anyface.report_is_error
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    return ob


def test_keys_of_ones_own_offer_the_outputs_that_work(addon, tmp_path):
    ob = heard(tmp_path, grid())
    own_keys(ob, "jawOpen")
    ob.anyface.mode = "arkit"
    fails("choose Existing Keys")
    assert offered(addon, ob) == ["Use Existing Keys", "Use New Keys"]
    assert mends("use_basis").anyface.mode == "basis"
    assert offered(addon, ob) == []


def test_keys_with_unknown_names_offer_to_make_some(addon, tmp_path):
    ob = heard(tmp_path, grid())
    own_keys(ob, "Smile")
    ob.anyface.mode = "keys"
    fails("no free shape key")
    assert offered(addon, ob) == ["Use Make ARKit Keys", "Use New Keys"]


def test_every_frame_beside_keys_of_ones_own_offers_new_keys(addon, tmp_path):
    ob = heard(tmp_path, grid())
    own_keys(ob, "Smile")
    ob.anyface.mode = "frames"
    fails("choose New Keys")
    assert mends("use_basis").data.shape_keys.key_blocks["Smile"]


def test_absolute_keys_offer_to_turn_relative_on(addon, tmp_path):
    ob = heard(tmp_path, grid())
    own_keys(ob, "Smile")
    ob.data.shape_keys.use_relative = False
    fails("turn Relative on")
    assert offered(addon, ob) == ["Turn Relative On"]
    mends("turn_relative_on")


def test_half_a_face_offers_to_apply_its_mirror(addon, tmp_path):
    ob = heard(tmp_path, grid())
    seam = min(vertex.co.x for vertex in ob.data.vertices)
    for vertex in ob.data.vertices:
        vertex.co.x -= seam
    ob.modifiers.new("Mirror", "MIRROR")
    fails("apply the modifier first")
    assert offered(addon, ob) == ["Apply Mirror"]
    assert not mends("apply_mirror").modifiers


def test_a_silent_sound_offers_to_choose_another(addon, tmp_path):
    ob = heard(tmp_path, grid())
    ob.anyface.sound_file = tone(tmp_path / "silence.wav", silent_until=2.0)
    fails("silent")
    assert offered(addon, ob) == ["Choose a Sound File…"]
    other = tone(tmp_path / "tone.wav")
    assert bpy.ops.anyface.choose_sound(filepath=other) == {"FINISHED"}
    assert ob.anyface.strip == "tone" or ob.anyface.sound_file == other
    assert not ob.anyface.report
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    with pytest.raises(RuntimeError, match="no sound file at"):
        bpy.ops.anyface.choose_sound(filepath=str(tmp_path / "none.wav"))


def test_a_strip_whose_file_is_gone_offers_to_find_it(addon, tmp_path):
    ob = heard(tmp_path, grid())
    sound = tmp_path / "moved.wav"
    try:
        strip(tone(sound), "Voice", 1, 1)
    except RuntimeError:
        pytest.skip("this Blender has no sound")
    ob.anyface.source, ob.anyface.strip = "STRIP", "Voice"
    sound.unlink()
    fails("no sound file at")
    assert offered(addon, ob) == ["Find Missing Files…", "Choose a Sound File…"]
    tone(sound)
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    ob.anyface.strip = "Vocie"
    fails("got 'Vocie'")
    assert offered(addon, ob) == ["Choose a Sound File…"]


def test_a_take_that_outlasts_the_scene_offers_to_extend_it(addon, tmp_path):
    ob, scene = heard(tmp_path, grid()), bpy.context.scene
    scene.frame_end = 20
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    # The take begins at frame 1.
    last = ob.anyface.last_frame
    assert last == int(ob.anyface.report.split(" frames")[0])
    late = f"The take goes on for {last - 20} frames after the end of the scene"
    assert offered(addon, ob) == [late, "Set Scene Range"]
    # The artist's own change of the range counts. The text of the report does not matter.
    scene.frame_end, ob.anyface.report = 30, "Spricht"
    assert offered(addon, ob)[0] == late.replace(str(last - 20), str(last - 30))
    assert bpy.ops.anyface.mend(name="scene_range") == {"FINISHED"}
    assert scene.frame_end == last and ob.anyface.report == "Spricht"
    assert offered(addon, ob) == []
    ob.anyface_output.shift = 5.0
    assert offered(addon, ob)[0] == "The take goes on for 5 frames after the end of the scene"
    assert bpy.ops.anyface.remove() == {"FINISHED"}
    assert offered(addon, ob) == []


def test_time_stretching_is_told_and_turned_off(addon, tmp_path):
    ob, render = heard(tmp_path, grid()), bpy.context.scene.render
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert offered(addon, ob) == []
    there = shape(ob, 21)
    render.frame_map_old, render.frame_map_new = 200, 100
    assert not np.allclose(shape(ob, 21), there)
    said, button = offered(addon, ob)
    assert "plays the face at 2 times its speed" in said and button == "Turn Time Stretching Off"
    assert bpy.ops.anyface.mend(name="stretching_off") == {"FINISHED"}
    assert offered(addon, ob) == [] and np.array_equal(shape(ob, 21), there)
    assert "shape keys" in ob.anyface.report


def test_each_take_knows_its_last_frame(addon, tmp_path):
    ob = heard(tmp_path, grid())
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    first = ob.anyface.last_frame
    ob.anyface_output.new_take, ob.anyface.start_frame = True, 101
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert ob.anyface.last_frame == first + 100
    waits = next(row for row in addon("scene.takes.take_list").rows(ob) if row.state == "WAITS")
    assert bpy.ops.anyface.take_switch(take=waits.id) == {"FINISHED"}
    assert ob.anyface.last_frame == first


def test_a_part_that_was_deleted_is_dropped(addon, tmp_path):
    teeth = grid("Teeth_lower", 5, 0.02)
    heard(tmp_path, grid())
    bpy.ops.anyface.generate()
    bpy.data.objects.remove(teeth)
    assert mends("drop_lost_parts").anyface_face.parts.keys() == []


def test_a_linked_face_offers_to_become_local(addon, tmp_path):
    grid("Linked")
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.data.objects["Linked"]})
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, names):
        names.objects = ["Linked"]
    (ob,) = names.objects
    bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.objects.active = ob
    assert offered(addon, ob) == ["Make Local"]
    assert bpy.ops.anyface.mend(name="make_local") == {"FINISHED"}
    local = bpy.context.scene.objects["Linked"]
    assert local.library is None and local.data.library is None
    assert offered(addon, local) == []


def test_a_face_that_is_not_found_offers_its_direction_and_a_file(addon, tmp_path):
    ob = heard(tmp_path, grid())
    finding, errors = addon("core.finding"), addon("core.errors")
    face = SimpleNamespace(name="Head", hints=["Half of the face comes from a Mirror modifier"])
    with pytest.raises(errors.AnyfaceError) as caught, finding.naming(face):
        raise errors.AnyfaceError("face", "no face")
    addon("ui.mending").keep(ob, caught.value.mends)
    assert addon("ui.mending").offers(ob) == [
        "place_points",
        "direction",
        "points_file",
        "apply_mirror",
    ]
    assert offered(addon, ob) == ["Place Points", "Apply Mirror"]


def test_only_what_is_known_is_mended(addon):
    grid()
    with pytest.raises(RuntimeError, match="expected one of use_basis"):
        bpy.ops.anyface.mend(name="everything")
    description = addon("ui.mending").ANYFACE_OT_mend.description
    assert "Mirror" in description(None, SimpleNamespace(name="apply_mirror"))


def test_every_mend_that_an_error_names_is_known(addon, installed):
    known = addon("ui.mending")
    names = {*known._MENDS, *known._OPERATORS, *known._SETTINGS}
    for name in known._OPERATORS.values():
        module, short = name[0].split(".")
        assert short in dir(getattr(bpy.ops, module))
    ob = grid()
    known.keep(ob, [*names, "of_a_later_version"])
    assert set(known.offers(ob)) == names
