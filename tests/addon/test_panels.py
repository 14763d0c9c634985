"""Draws every panel on `Paper`, a layout that accepts only what Blender's own accepts."""

import tomllib
from types import SimpleNamespace

import bpy
import pytest

from figures import grid, own_keys, stand_in, tone

# The stages that the library reports, and words that no artist should see.
STAGES = ["sound", "speech", "motion", "landmarks", "operators", "weights", "deform", "compress"]
STAGES += ["sliders", "rig", "solve", "write"]
JARGON = (
    "basis keys",
    "emotion from",
    "lips to jaw",
    "new run",
    "68 landmarks",
    "sliders",
    "solve",
    "of the motion shown",
    "largest error",
    "arousal",
    "decoder",
)
PANELS = ("panel", "character", "emotions", "performance", "life", "outputs", "takes", "scene_list")
ICONS = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()


class Paper:
    """Accepts what `UILayout` accepts, and records texts and greyed properties."""

    def __init__(self, words, enabled=True):
        self.__dict__.update(words=words, enabled=enabled)

    def __setattr__(self, name, value):
        assert name in bpy.types.UILayout.bl_rna.properties, name
        self.__dict__[name] = value

    def __getattr__(self, name):
        function = bpy.types.UILayout.bl_rna.functions[name]

        def call(*arguments, **named):
            known = [item.identifier for item in function.parameters]
            assert set(named) <= {*known, "text_ctxt", "translate"}, (name, named)
            assert named.get("icon", "NONE") in ICONS, named
            if name in ("prop", "prop_enum", "prop_search"):
                assert arguments[1] in arguments[0].bl_rna.properties, arguments
            value = arguments[2] if name == "prop_enum" else ""
            self.words.append((named.get("text", value), self.enabled))
            if name == "operator":
                module, short = arguments[0].split(".")
                assert short in dir(getattr(bpy.ops, module)), arguments
                return SimpleNamespace()
            paper = Paper(self.words, self.enabled)
            return (paper, paper) if name in ("panel", "panel_prop") else paper

        return call


def draw_all(addon):
    """Draws every panel of the extension. Returns the words of each panel."""
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
    for name in PANELS:
        for cls in vars(addon(f"ui.{name}")).values():
            if not getattr(cls, "__name__", "").startswith("ANYFACE_PT"):
                continue
            words = drawn[cls.__name__] = []
            if not hasattr(cls, "poll") or cls.poll(context):
                cls.draw(SimpleNamespace(layout=Paper(words)), context)
    return drawn


@pytest.fixture
def stage(addon):
    """A `Stage` that replaces the engine."""
    stand_in(addon)
    bpy.context.window_manager.anyface_more = True


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
    assert grey == {"frames", "cache", "arkit", "csv", "controls"}
    ob.anyface.mode = "frames"
    words = " ".join(text for text, _ in draw_all(addon)["ANYFACE_PT_output"])
    assert "choose New Keys" in words


def test_controls_are_drawn_where_they_belong(addon, stage, monkeypatch):
    grid()
    shown = []
    draw = Paper.__getattr__
    monkeypatch.setattr(Paper, "__getattr__", lambda self, name: noting(draw(self, name), name))

    def noting(call, kind):
        def noted(*arguments, **named):
            shown.extend(arguments[1:2] if kind == "prop" else ())
            return call(*arguments, **named)

        return noted

    monkeypatch.setattr(addon("ui.preferences"), "shows_research", lambda: True)
    draw_all(addon)
    assert ("system" in shown) == (len(addon("core.systems").known()) > 1)
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


RESEARCH = ("guidance", "template", "decoder", "field", "noise", "steps")


@pytest.mark.parametrize("system", ["freetalk", "cafe-talk", "emoface", "facetalk"])
def test_words_of_research_are_shown_to_whoever_wants_them(addon, stage, monkeypatch, system):
    ob, systems = grid(), addon("core.systems")
    ob.anyface.system = system
    assert not addon("ui.preferences").shows_research(), "off unless it is wanted"
    shown = []
    draw = Paper.__getattr__

    def noting(self, name):
        call = draw(self, name)
        return lambda *a, **b: (shown.extend(a[1:2] if name == "prop" else ()), call(*a, **b))[1]

    monkeypatch.setattr(Paper, "__getattr__", noting)
    draw_all(addon)
    controls = systems.by_name(system).controls
    names = [c.name for c in controls if any(word in c.name for word in RESEARCH)]
    assert names and not set(names) & set(shown) and "articulation" in shown
    # A control that somebody has changed is shown, so that it never acts unseen.
    first = next(c for c in controls if c.name in names and not c.choices)
    name = first.name
    other = first.high if first.default < first.high else first.low
    setattr(ob.anyface, name, int(other) if first.values == systems.WHOLE else other)
    shown.clear()
    draw_all(addon)
    assert set(names) & set(shown) == {name}
    addons = bpy.context.preferences.addons["bl_ext.user_default.anyface"]
    addons.preferences.research = True
    try:
        shown.clear()
        draw_all(addon)
        assert set(names) <= set(shown)
    finally:
        addons.preferences.research = False


def test_buttons_are_called_what_they_do(addon):
    assert addon("ui.sounds").ANYFACE_OT_redo.bl_label == "Redo Stretch"
    assert addon("ui.outputs").ANYFACE_OT_why_not.bl_label == "Why Unavailable?"


def drawn_main(addon):
    """The words of the first screen."""
    return [text for text, _ in draw_all(addon)["ANYFACE_PT_main"] if text]


def test_the_first_screen_suffices_and_more_is_closed(addon, stage, tmp_path):
    bpy.context.window_manager.anyface_more = False
    assert "Click a face, or add one:" in drawn_main(addon)
    ob = grid()
    assert "Choose a Sound File…" in drawn_main(addon)
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
    words = drawn_main(addon)
    assert words[-1] == "More" and "Generate" in words
    assert {"Style", "Natural", "Emotion"} <= set(words)
    assert sum(map(len, draw_all(addon).values())) == len(draw_all(addon)["ANYFACE_PT_main"])
    # A line is at most 26 pixels high, and the sidebar is 620 pixels high at 1280 x 800.
    assert len(words) <= 12


def test_one_emotion_is_a_line_and_each_further_one_is_a_line_more(addon, stage, tmp_path):
    ob = grid()
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
    lines = lambda: len(draw_all(addon)["ANYFACE_PT_main"])  # noqa: E731
    one = lines()
    bpy.ops.anyface.emotion_add()
    two = lines()
    bpy.ops.anyface.emotion_add()
    assert two - one == lines() - two > 0
    ob.anyface.intensity = ob.anyface.mixture[0].weight = 1.2
    ob.anyface.emotion = "sad"
    assert "2.90 in sum, shown as 1.5" in drawn_main(addon)
    ob.anyface.emotion_source = "OFF"
    assert "Emotion" not in drawn_main(addon) and lines() < one


def test_pictures_are_shown_once_they_are_drawn(addon, stage, tmp_path, monkeypatch):
    ob = grid()
    words = [text for text, _ in draw_all(addon)["ANYFACE_PT_emotion"]]
    assert not any("at 0.80" in text for text in words)
    pictures = addon("ui.pictures")
    monkeypatch.setattr(pictures, "_icon", lambda _folder, _name: 0)
    pictures.show(ob, tmp_path, 0.8)
    words = [text for text, _ in draw_all(addon)["ANYFACE_PT_emotion"]]
    assert "Neutral, at 0.80" in words


def test_style_is_the_preset_that_the_sliders_show(addon, stage):
    ob, name_of = grid(), addon("ui.presets").name_of
    presets = addon("ui.presets")
    assert name_of(ob.anyface) == "Natural"
    ob.anyface.emotion = "happy"
    assert name_of(ob.anyface) == "Natural", "emotion has a line of its own"
    for preset in presets.everyone():
        presets.apply(preset, ob.anyface)
        assert name_of(ob.anyface) == preset.name
    ob.anyface.articulation = 0.123
    assert name_of(ob.anyface) == "My Own"


def test_no_panel_speaks_in_jargon(addon, stage, tmp_path):
    ob = grid()
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
    bpy.ops.anyface.generate()
    said = [text for words in draw_all(addon).values() for text, _ in words]
    rna = [ob.anyface, ob.anyface_output, ob.anyface_face, ob.anyface_life_settings]
    said += [prop.name for group in rna for prop in group.bl_rna.properties]
    said += [item.name for item in ob.anyface.bl_rna.properties["mode"].enum_items]
    said.append(ob.anyface.report)
    said += [addon("ui.words").of_stage(name) for name in STAGES]
    text = "\n".join(said).lower()
    for jargon in JARGON:
        assert jargon not in text, jargon


def test_every_stage_has_words_of_its_own(addon):
    of_stage = addon("ui.words").of_stage
    assert "working" not in map(of_stage, STAGES)
    assert of_stage("of a later version") == "working" and of_stage("") == "starting"


def test_shares_are_said_in_words(addon):
    share = addon("core.wording").share
    assert share(0.66) == "about two thirds of the motion (66 %)"
    words = [share(part).partition(" of the")[0] for part in (0.9, 0.89, 0.75, 0.74, 0.6, 0.59)]
    thirds = "about two thirds"
    assert words == ["nearly all", "most", "most", thirds, thirds, "about half"]
    assert share(0.4).startswith("about half") and share(0.39).startswith("less than half")


def test_the_manual_is_there_without_internet(addon, stage, installed):
    path, words = addon("ui.panel").HELP, []
    assert path.parent == installed and path.read_text(encoding="utf-8").startswith("# Anyface in")
    panel = SimpleNamespace(layout=Paper(words))
    addon("ui.panel").ANYFACE_PT_main.draw_header_preset(panel, None)
    assert len(words) == 1


def test_the_manifest_tells_what_is_true(installed):
    manifest = tomllib.loads((installed / "blender_manifest.toml").read_text(encoding="utf-8"))
    # The extension has no website yet.
    assert "website" not in manifest
    assert manifest["copyright"][0] == "2026 The Anyface authors"
    files = manifest["permissions"]["files"]
    assert len(files) <= 64 and "exports" in files and "caches" in files


def test_size_and_time_are_told_before(addon, stage, tmp_path):
    estimate = addon("core.estimate")
    workload = estimate.Asked(1500, 26719, 50.0, keys=52)
    costs = {output.name: output.cost(workload) for output in addon("scene.outputs").ALL}
    assert costs["frames"].size > 400e6 and costs["cache"].size > 400e6
    assert costs["basis"].size < 30e6 and costs["keys"].size < costs["arkit"].size < 30e6
    assert costs["cache"].beside and not costs["basis"].beside
    first, again = (estimate.seconds_of(costs["basis"], workload, known) for known in (False, True))
    assert again < first
    text = estimate.in_words(costs["basis"], workload, known=False)
    assert text.startswith("1500 frames, about 2") and "MB in the .blend" in text


def test_long_text_is_wrapped_to_what_fits_beside_an_icon(addon):
    letters = addon("ui.words").letters
    assert letters(280, False) == 37 and letters(280, True) == 34
    assert letters(560, False) > 70 and letters(90, True) == 20


def test_the_report_counts_and_has_details_on_demand(addon, stage, tmp_path):
    ob = grid()
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    manager, said = bpy.context.window_manager, " ".join(drawn_main(addon))
    assert ob.anyface.report.startswith("48 frames, 6 shape keys") and "mm" not in said
    assert "Details" not in said, "the name of the property is drawn"
    manager.anyface_details = True
    try:
        said = " ".join(drawn_main(addon))
        assert "moves by up to 5.0 mm" in said and "exact to 0.00 mm" in said
    finally:
        manager.anyface_details = False


def test_lengths_are_those_of_the_face_that_is_there(addon, stage, tmp_path):
    for scale, said in ((0.2, "5.0 mm"), (40.0, "2.2 % of the head's height"), (0.01, "2.2 %")):
        ob = grid(scale=scale)
        ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
        assert bpy.ops.anyface.generate() == {"FINISHED"}
        assert f"moves by up to {said}" in ob.anyface.report_details
        assert ("mm" in ob.anyface.report_details) == (scale == 0.2)
    # The scene's unit scale counts: here 40 units are 40 centimetres.
    bpy.context.scene.unit_settings.scale_length = 0.01
    ob = grid(scale=40.0)
    ob.anyface.source, ob.anyface.sound_file = "FILE", tone(tmp_path / "tone.wav")
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    assert "mm" in ob.anyface.report_details
