"""Every panel is drawn on paper: a layout that knows what Blender's own takes."""

from types import SimpleNamespace

import bpy
import pytest

from figures import grid, own_keys, stand_in, tone

ICONS = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()


class Paper:
    """Takes what `UILayout` takes, and remembers texts and greyed properties."""

    def __init__(self, words, enabled=True):
        self.__dict__.update(words=words, enabled=enabled)

    def __setattr__(self, name, value):
        assert name in bpy.types.UILayout.bl_rna.properties, name
        self.__dict__[name] = value

    def __getattr__(self, name):
        function = bpy.types.UILayout.bl_rna.functions[name]

        def call(*given, **named):
            known = [item.identifier for item in function.parameters]
            assert set(named) <= {*known, "text_ctxt", "translate"}, (name, named)
            assert named.get("icon", "NONE") in ICONS, named
            if name in ("prop", "prop_enum", "prop_search"):
                assert given[1] in given[0].bl_rna.properties, given
            value = given[2] if name == "prop_enum" else ""
            self.words.append((named.get("text", value), self.enabled))
            if name == "operator":
                module, short = given[0].split(".")
                assert short in dir(getattr(bpy.ops, module)), given
                return SimpleNamespace()
            made = Paper(self.words, self.enabled)
            return (made, made) if name in ("panel", "panel_prop") else made

        return call


def draw_all(addon):
    """Draws every panel of the extension; the words by panel."""
    context = SimpleNamespace(
        scene=bpy.context.scene,
        object=bpy.context.object,
        active_object=bpy.context.object,
        region=SimpleNamespace(width=280),
        mode="OBJECT",
        window_manager=bpy.context.window_manager,
        selected_objects=[],
    )
    drawn = {}
    for name in ("panel", "performance", "outputs", "takes", "scene_list"):
        for cls in addon(f"ui.{name}").CLASSES:
            if not issubclass(cls, bpy.types.Panel):
                continue
            words = drawn[cls.__name__] = []
            if not hasattr(cls, "poll") or cls.poll(context):
                cls.draw(SimpleNamespace(layout=Paper(words)), context)
    return drawn


@pytest.fixture
def stage(addon):
    """A stage in the engine's place."""
    stand_in(addon)


def test_panels_draw_without_and_with_a_face(addon, stage, tmp_path):
    draw_all(addon)
    ob = grid()
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
    bpy.context.scene.anyface_list.add().character = ob
    for mode in addon("scene.outputs").MODES:
        ob.anyface.mode = mode
        assert draw_all(addon)["ANYFACE_PT_output"]
    ob.anyface.mode = "basis"
    bpy.ops.anyface.generate()
    bpy.ops.anyface.take_keep()
    bpy.ops.anyface.generate()
    texts = [text for text, _ in draw_all(addon)["ANYFACE_PT_takes"]]
    assert "Take 1" in texts and "Take 2" in texts


def test_outputs_that_cannot_work_are_grey_and_the_chosen_one_says_why(addon, stage):
    ob = grid()
    own_keys(ob, "Smile", "jawOpen")
    drawn = draw_all(addon)["ANYFACE_PT_output"]
    grey = {text for text, enabled in drawn if not enabled}
    assert grey == {"frames", "cache", "arkit", "csv"}
    ob.anyface.mode = "frames"
    words = " ".join(text for text, _ in draw_all(addon)["ANYFACE_PT_output"])
    assert "choose basis keys" in words


def test_controls_are_drawn_where_they_belong(addon, stage, monkeypatch):
    grid()
    shown = []
    draw = Paper.__getattr__
    monkeypatch.setattr(Paper, "__getattr__", lambda self, name: noting(draw(self, name), name))

    def noting(call, kind):
        def noted(*given, **named):
            shown.extend(given[1:2] if kind == "prop" else ())
            return call(*given, **named)

        return noted

    draw_all(addon)
    assert "system" not in shown, "there is one system"
    more = shown.index("seed")
    assert shown.index("articulation") < shown.index("asymmetry") < more
    assert more < shown.index("steps") < shown.index("learned") < shown.index("decoder")
    systems = addon("core.systems")
    known = systems.known()
    monkeypatch.setattr(systems, "known", lambda: known * 2)
    draw_all(addon)
    assert "system" in shown
    monkeypatch.setattr(systems, "known", lambda: ())
    shown.clear()
    draw_all(addon)
    assert "emotion" in shown and "articulation" not in shown


def test_size_and_time_are_told_before(addon, stage, tmp_path):
    estimate = addon("core.estimate")
    asked = estimate.Asked(1500, 26719, 50.0, keys=52)
    found = {output.name: output.cost(asked) for output in addon("scene.outputs").ALL}
    assert found["frames"].size > 400e6 and found["cache"].size > 400e6
    assert found["basis"].size < 30e6 and found["keys"].size < found["arkit"].size < 30e6
    assert found["cache"].beside and not found["basis"].beside
    first, again = (estimate.seconds_of(found["basis"], asked, known) for known in (False, True))
    assert again < first
    text = estimate.in_words(found["basis"], asked, known=False)
    assert text.startswith("1500 frames, about 2") and "MB in the .blend" in text


def test_long_text_is_wrapped_to_what_fits_beside_an_icon(addon):
    letters = addon("ui.words").letters
    assert letters(280, False) == 37 and letters(280, True) == 34
    assert letters(560, False) > 70 and letters(90, True) == 20
