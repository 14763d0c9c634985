"""Compares the binding with the header, and tests the library itself."""

import ctypes
import re
from contextlib import ExitStack

import numpy as np
import pytest

from conftest import ROOT

HEADER = (ROOT / "include" / "anyface.h").read_text()
NUMBERS = {
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "size_t": ctypes.c_size_t,
    "uint32_t": ctypes.c_uint32,
    "uint64_t": ctypes.c_uint64,
    "int32_t": ctypes.c_int32,
    "int": ctypes.c_int,
    "AnyfaceStatus": ctypes.c_int32,
    "AnyfaceProgressFn": ctypes.c_void_p,
    "AnyfaceFramesFn": ctypes.c_void_p,
}


def plain(header):
    """The header without comments."""
    return re.sub(r"/\*.*?\*/|//[^\n]*", "", header, flags=re.DOTALL)


def as_ctypes(declaration):
    """The ctypes type of a C declaration without its name, such as `const float *`."""
    stars = declaration.count("*")
    name = re.sub(r"\b(const|struct|enum)\b|\*", "", declaration).strip()
    if stars == 0:
        return None if name == "void" else NUMBERS[name]
    if name == "char" and "const" in declaration:
        return [ctypes.c_char_p, ctypes.POINTER(ctypes.c_char_p)][stars - 1]
    if stars == 2:
        return ctypes.POINTER(ctypes.c_void_p)
    return ctypes.POINTER(NUMBERS[name]) if name in NUMBERS else ctypes.c_void_p


def split(declaration):
    """A C declaration as type and name."""
    kind, name = re.fullmatch(r"(.*?)(\w+)", declaration.strip(), flags=re.DOTALL).groups()
    return kind, name


def functions():
    """Every function of the header: its name, result type and argument types."""
    pattern = r"([\w \*]+?)\b(anyface_\w+)\(([^)]*)\);"
    for result, name, text in re.findall(pattern, plain(HEADER)):
        words = [] if text.strip() in ("", "void") else text.split(",")
        arguments = [as_ctypes(split(word)[0]) for word in words]
        yield name, (as_ctypes(result), arguments)


def test_signatures_are_those_of_the_header(addon):
    known = dict(functions())
    assert len(known) > 40
    assert known == addon("core.signatures").SIGNATURES


def test_the_interface_version_is_that_of_the_header(addon):
    version = int(re.search(r"ANYFACE_ABI_VERSION (\d+)", HEADER).group(1))
    assert version == addon("core.library").ABI_VERSION


@pytest.fixture(scope="module")
def engine():
    """The engine of the installed library."""
    import importlib

    from conftest import PACKAGE

    engine = importlib.import_module(f"{PACKAGE}.core.native").Engine()
    yield engine
    engine.close()


def test_emotions_are_those_of_the_library(addon, engine):
    assert tuple(engine.emotions()) == addon("core.emotion").EMOTIONS


def test_controls_are_numbers_that_the_library_takes(addon, engine):
    systems, take = addon("core.systems"), addon("core.take")
    known = systems.find("", systems.known())
    request = take.Request(24.0, controls={c.name: c.default for c in known.controls})
    stages = systems.FACE, systems.MOTION
    face, motion = ([c.name for c in known.controls if c.stage == stage] for stage in stages)
    assert "learned" in face and "articulation" in motion
    with ExitStack() as handles:
        assert all(engine._controls(handles, request, stage) for stage in stages)
    assert {"text", "neutral_voice", "closures"} <= {known.name for known in known.fields}
    with pytest.raises(addon("core.errors").AnyfaceError, match="expected one of freetalk"):
        systems.find("nobody", systems.known())


def test_sounds_are_decoded_to_mono(addon, engine, tmp_path):
    from figures import tone

    path = tone(tmp_path / "tön.wav", seconds=1.5, rate=44100)
    samples, rate, missing = engine.decode(path)
    assert rate == 16000.0 and len(samples) == pytest.approx(24000, abs=2) and missing == ""
    assert np.abs(samples).max() == pytest.approx(0.5, abs=0.02)
    whole = (tmp_path / "tön.wav").read_bytes()
    (tmp_path / "tön.wav").write_bytes(whole[: len(whole) * 9 // 10])
    assert "of 1.50 s are missing" in engine.decode(path)[2]
    (tmp_path / "tön.wav").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(addon("core.errors").AnyfaceError, match="are missing"):
        engine.decode(path)
    with pytest.raises(addon("core.errors").AnyfaceError, match="are missing"):
        addon("scene.sound.decode").decoder(engine)(path)
    (tmp_path / "text.wav").write_text("no sound")
    with pytest.raises(addon("core.errors").AnyfaceError) as caught:
        engine.decode(str(tmp_path / "text.wav"))
    assert caught.value.kind == "audio"


def test_words_of_a_text_are_heard_beside_closures(addon, engine):
    noise = np.random.default_rng(0).normal(0.0, 0.1, 24_000).astype(np.float32)
    sound = addon("core.take").Sound(noise, 16000.0, "noise")
    closures, words = engine.listen_to_words(sound, "Bär, öl")
    assert closures.shape[1] == 2 and np.isfinite(closures).all()
    assert [word[2] for word in words] == ["Bär", "öl"]
    assert 0.0 <= words[0][0] < words[0][1] <= words[1][0] < words[1][1] <= 1.5
    with pytest.raises(addon("core.errors").AnyfaceError, match="no letter"):
        engine.listen_to_words(sound, "…")


def test_another_interface_version_is_refused(addon, monkeypatch):
    monkeypatch.setattr(addon("core.library"), "ABI_VERSION", 99)
    with pytest.raises(addon("core.errors").AnyfaceError, match="expected interface 99, got 1"):
        addon("core.native").Engine()


def test_a_missing_library_is_named(addon, monkeypatch):
    monkeypatch.setenv("ANYFACE_LIBRARY", "/nowhere/libanyface.so")
    with pytest.raises(addon("core.errors").AnyfaceError, match="nowhere"):
        addon("core.native").Engine()


def test_bad_meshes_and_sounds_are_errors_in_words(addon, engine):
    take, job = addon("core.take"), addon("core.job")
    sound = take.Sound(np.zeros(16000, dtype=np.float32) + 0.1, 16000, "Voice")
    triangle = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], dtype=np.uint32)
    ask = take.Request(24.0)
    for mesh in (triangle, (triangle[0], triangle[1] + 5), (triangle[0] * np.nan, triangle[1])):
        with pytest.raises(addon("core.errors").AnyfaceError) as caught:
            engine.animate(*mesh, None, None, sound, ask, job.Progress())
        assert caught.value.kind in ("mesh", "face")


def test_shapes_are_those_of_the_library(addon, engine):
    import json

    import bpy

    from test_heads import HEAD, LANDMARKS

    bpy.ops.wm.obj_import(
        filepath=str(HEAD),
        use_split_objects=False,
        use_split_groups=False,
        forward_axis="Y",
        up_axis="Z",
    )
    ob = bpy.context.object
    mesh, space = addon("scene.face.mesh"), addon("core.space")
    ob["anyface_landmarks"] = json.dumps([row["vertex"] for row in LANDMARKS])
    face = mesh.read_face(ob)
    turned = space.face_space(np.eye(4), "LOCAL_Y_UP")
    points = turned.points(face.positions)
    progress = addon("core.job").Progress()
    rig = engine.rig(points, face.triangles, None, face.landmark_vertices, None, progress)
    shapes = addon("core.shapes")
    assert tuple(rig.names) == (*shapes.ARKIT, *shapes.VISEMES)
    jaw = rig.names.index("jawOpen")
    assert np.linalg.norm(rig.vectors[jaw], axis=1).max() > 0.01
    moved = np.linspace(0.0, 0.8, 9, dtype=np.float32)[:, None, None] * rig.vectors[jaw]
    solved = engine.solve(rig.names[:52], rig.vectors[:52], [], moved, progress)
    assert solved.weights[-1, jaw] == pytest.approx(0.8, abs=0.05) and solved.left_out < 0.1
    # The weights of a clip that stays in the library equal those of its copy in object space, to
    # the bit.
    take = addon("core.take")
    at = np.arange(16000) / 16000.0
    tone = 0.5 * np.sin(2 * np.pi * 140.0 * at) * np.sin(2 * np.pi * 2.1 * at) ** 2
    sound = take.Sound(tone.astype(np.float32), 16000, "Voice")
    ask = take.Request(24.0, keeps_clip=True)
    arguments = points, face.triangles, None, face.landmark_vertices, sound, ask, progress
    clip = engine.animate(*arguments).clip
    vectors = turned.to_object(rig.vectors[:52])[:, :-5]
    lips = np.array(face.landmark_vertices)[[[61, 67], [62, 66], [63, 65]]]
    on_clip = clip.weights(rig.names[:52], vectors, lips, turned.back, progress)
    copied = turned.to_object(clip.displacements())[:, :-5]
    of_copy = engine.solve(rig.names[:52], vectors, lips, copied, progress)
    assert on_clip.weights.max() > 0.05 and on_clip.left_out == of_copy.left_out
    assert np.array_equal(on_clip.weights, of_copy.weights)
    by = addon("core.take").ShapesBy(field=True, in_betweens=True)
    arguments = points, face.triangles, None, face.landmark_vertices, None, progress, by
    bent = engine.rig(*arguments)
    assert bent.names[:67] == rig.names and bent.names[67 + jaw] == "jawOpen_half"
    whole, half = bent.vectors[jaw], bent.vectors[67 + jaw]
    assert np.linalg.norm(half, axis=1).max() < 0.6 * np.linalg.norm(whole, axis=1).max()
    assert not np.array_equal(whole, rig.vectors[jaw])


def test_a_chart_is_drawn_of_the_default_head_and_obeys_its_closures(addon, engine):
    module, take = addon("core.mouth_chart"), addon("core.take")
    head = addon("scene.face.sample_head").points_and_triangles(0.38)
    noise = np.random.default_rng(0).normal(0.0, 0.1, 32_000).astype(np.float32)
    sound = take.Sound(noise, 16000.0, "noise")
    progress = addon("core.job").Progress()
    fields = {"emotion": "off", "closures": np.array([[0.5, 0.6], [1.2, 1.3]])}
    request = take.Request(24.0, fields)
    for kind, closed in [(module.RHUBARB, "A"), (module.PRESTON_BLAIR, "MBP")]:
        arguments = *head, None, None, sound, request, progress, kind, 2, 2
        chart = engine.chart(*arguments, closure_hold=6)
        assert {mouth for _, _, mouth in chart} <= set(module.MOUTHS[kind])
        assert chart[0][0] == 0.0 and chart[-1][1] == pytest.approx(2.0, abs=0.1)
        shut = [(start, end) for start, end, mouth in chart if mouth == closed]
        for start_s, end_s in fields["closures"]:
            inside = [(a, b) for a, b in shut if a <= start_s and b >= end_s]
            assert inside and all((b - a) * 24.0 >= 5.9 for a, b in inside)
