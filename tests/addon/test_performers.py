"""Performers learned from what an artist has on the timeline, with the real library."""

import json

import bpy
import numpy as np
import pytest

from figures import FPS, babble, film, grid, stand_in, tone

SECONDS = 8.0
FRAMES = np.arange(1, int(SECONDS * FPS))
# Where `babble` opens its vowels, 0 to 1.
OPENED = 0.5 - 0.5 * np.cos(2 * np.pi * 3.0 * (FRAMES - 1) / FPS)
CORNERS = [48, 54]


@pytest.fixture
def folder(tmp_path, addon):
    """The folder of performers that the preferences name."""
    stored = bpy.context.preferences.addons[addon("ui.preferences").PACKAGE].preferences
    stored.performer_folder = str(tmp_path / "performers")
    yield tmp_path / "performers"
    stored.performer_folder = ""


@pytest.fixture
def ob(tmp_path):
    """The sample head with eight seconds of a voice from frame 1 on."""
    bpy.context.scene.render.fps = FPS
    assert bpy.ops.anyface.add_sample_head() == {"FINISHED"}
    head = bpy.context.object
    head.anyface.source, head.anyface.sound_file = "FILE", babble(tmp_path / "a.wav", SECONDS)
    head.anyface.emotion_source = "OFF"
    return head


def generate(ob):
    assert bpy.ops.anyface.generate() == {"FINISHED"}, ob.anyface.report


def learn(name, operator="performer_learn", **options):
    return getattr(bpy.ops.anyface, operator)(name=name, **options)


def corners(addon, ob):
    """The vertices of both corners of the mouth, and the widths `[T]` of the mouth, mm."""
    settings = addon("ui.settings").from_object(ob)
    engine = addon("ui.running").engine(settings.system)
    face, progress = addon("scene.bake").read_face(ob, settings), addon("core.job").Progress()
    place = addon("core.finding").find(face, {}, engine.find, progress)
    vertices = place.vertices[CORNERS].astype(int)
    apart = np.diff(film(ob, FRAMES)[:, vertices], axis=1)[:, 0]
    mm = addon("core.performers").mm_per_unit(place.positions)
    return vertices, np.linalg.norm(apart, axis=1) * mm, mm


def keyed(block, values):
    for frame, value in zip(FRAMES, values, strict=True):
        block.value = value
        block.keyframe_insert("value", frame=int(frame))


def corrected(addon, ob):
    """Brings the corners together by 6 mm where the mouth is open, with a key of the artist's."""
    vertices, _, mm = corners(addon, ob)
    block = ob.shape_key_add(name="Narrow", from_mix=False)
    rest = np.array([point.co for point in ob.data.shape_keys.reference_key.points])
    middle = rest[vertices].mean(axis=0)
    for vertex in vertices:
        near = np.exp(-((np.linalg.norm(rest - rest[vertex], axis=1) * mm / 8.0) ** 2))
        inward = (middle - rest[vertex]) / np.linalg.norm(middle - rest[vertex])
        for number in np.flatnonzero(near > 0.01):
            block.points[number].co = np.array(block.points[number].co) + (
                3.0 / mm * near[number] * inward
            )
    keyed(block, np.clip(2.5 * OPENED - 1.5, 0.0, 1.0))


def test_a_take_that_was_corrected_by_hand_teaches_how_the_next_one_speaks(
    addon, ob, folder, tmp_path
):
    generate(ob)
    before = ob.anyface.report
    with pytest.raises(RuntimeError, match="as it was generated"):
        learn("Kim")
    corrected(addon, ob)
    bpy.context.scene.frame_set(7)
    assert learn("Kim") == {"FINISHED"}
    assert bpy.context.scene.frame_current == 7
    path = folder / "Kim.performer"
    assert ob.anyface.performer == str(path) and path.stat().st_size < 200_000
    assert "corner" in ob.anyface.report and "corrected take" in ob.anyface.report != before

    # The next line has another pitch and other lengths, and no correction.
    ob.data.shape_keys.key_blocks["Narrow"].mute = True
    ob.anyface.sound_file = babble(tmp_path / "b.wav", SECONDS + 0.6)
    ob.anyface.performer = ""
    generate(ob)
    _, plain, _ = corners(addon, ob)
    ob.anyface.performer = str(path)
    generate(ob)
    _, spoken, _ = corners(addon, ob)
    narrower = plain - spoken
    opened = OPENED > 0.95
    print(f"narrower by {narrower[opened].mean():.2f} mm open, {narrower[~opened].mean():.2f} else")
    assert narrower[opened].mean() > 2.0 > narrower[OPENED < 0.1].mean() + 1.0

    written = path.read_bytes()
    with pytest.raises(RuntimeError, match="exists already"):
        learn("Kim")
    assert path.read_bytes() == written


def test_keys_that_an_artist_animated_and_a_recording_teach_too(addon, ob, folder, tmp_path):
    assert bpy.ops.anyface.expression_keys() == {"FINISHED"}
    blocks = ob.data.shape_keys.key_blocks
    keyed(blocks["jawOpen"], 0.5 * OPENED)
    keyed(blocks["mouthPucker"], 0.8 * OPENED)
    assert learn("By Hand") == {"FINISHED"}
    assert (folder / "By_Hand.performer").is_file()

    names = addon("core.shapes").ARKIT
    columns = {name: np.zeros(len(FRAMES)) for name in names}
    columns["jawOpen"], columns["mouthPucker"] = 0.5 * OPENED, 0.8 * OPENED
    rows = [f"Timecode,BlendShapeCount,{','.join(names)}"]
    for at, values in enumerate(zip(*columns.values(), strict=True)):
        code = f"10:00:{at // FPS:02}:{at % FPS:02}.000"
        rows.append(f"{code},{len(names)},{','.join(f'{value:.5f}' for value in values)}")
    recording = tmp_path / "Anna.csv"
    recording.write_text("\n".join(rows))
    done = learn("", "performer_learn_file", filepath=str(recording))
    assert done == {"FINISHED"} and ob.anyface.performer == str(folder / "Anna.performer")
    listed = [path.stem for path in addon("ui.performers").everyone()]
    assert listed == ["Anna", "By_Hand"]
    scores = addon("core.native_performers").card_of(ob.anyface.performer)
    assert scores["takes"][0]["name"] == "Anna.csv" and str(tmp_path) not in json.dumps(scores)

    assert bpy.ops.anyface.performer_use(path="") == {"FINISHED"}
    assert ob.anyface.performer == ""
    with pytest.raises(RuntimeError, match=r"expected one of Anna, By_Hand"):
        bpy.ops.anyface.performer_delete(path=str(recording))
    deleted = bpy.ops.anyface.performer_delete(path=str(folder / "Anna.performer"))
    assert deleted == {"FINISHED"} and recording.is_file()
    assert [path.stem for path in addon("ui.performers").everyone()] == ["By_Hand"]


def test_what_teaches_nothing_is_refused_in_words(addon, tmp_path, folder):
    stand_in(addon)
    bpy.context.scene.render.fps = FPS
    face = grid()
    face.anyface.source, face.anyface.sound_file = "FILE", tone(tmp_path / "a.wav", 1.0)
    with pytest.raises(RuntimeError, match="letters or digits"):
        learn("...")
    with pytest.raises(RuntimeError, match=r"no file at .*gone\.csv"):
        learn("", "performer_learn_file", filepath=str(tmp_path / "gone.csv"))
    known = addon("core.systems")
    without = known.System("toy", "Toy", "", ())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(known, "by_name", lambda _name: without)
        with pytest.raises(RuntimeError, match="Toy shows no performers: choose FreeTalk or"):
            learn("Kim")
    assert not list(folder.glob("*"))


def test_the_motion_of_the_head_is_taken_off(addon):
    module = addon("core.performers")
    random = np.random.default_rng(1)
    rest = random.uniform(-0.05, 0.05, (68, 3))
    rest[36], rest[45] = (-0.045, 0.03, 0.0), (0.045, 0.03, 0.0)
    spoken = np.zeros((20, 68, 3))
    spoken[:, 48:, 1] = 0.004 * np.sin(np.arange(20))[:, None]
    angles = 0.3 * np.sin(0.2 * np.arange(20))
    turns = np.array([[[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]
                      for a in angles])  # fmt: skip
    turned = np.einsum("tij,tnj->tni", turns, rest + spoken) + 0.02 - rest
    assert np.abs(module.without_head(turned, rest) - spoken).max() < 1e-9
    assert module.without_head(spoken, rest) is spoken


def test_the_sentence_says_what_differs(addon):
    def score(name, r, slope, r_without, slope_without):
        names = ("name", "r", "slope", "r_without", "slope_without")
        return dict(zip(names, (name, r, slope, r_without, slope_without), strict=True))

    card = {
        "takes": [{"name": "a", "seconds": 15.0, "lag_s": 0.12}],
        "scores": [
            score("gap", 0.9, 0.9, 0.8, 0.64),
            score("width", 0.84, 0.5, 0.61, 0.61),
            score("chin", 0.8, 0.8, 0.8, 0.8),
        ],
    }
    assert addon("core.performers").describe(card) == (
        "moves the corners 40 % less and opens the mouth 25 % wider; follows the take 0.84 where "
        "the model alone follows 0.61; it was 0.12 s behind its sound, taken off"
    )
