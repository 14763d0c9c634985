"""Calls the package as a pipeline does: meshes and sounds in, motion out."""

import importlib
import json
import threading

import numpy as np
import pytest

from conftest import HEAD, RATE_HZ, spoken, write_wav


@pytest.fixture(scope="module")
def mesh(anyface):
    """Vertices and triangles of the default head."""
    vertices, triangles = anyface.Engine().read_mesh(str(HEAD))
    return vertices, triangles


def test_a_clip_is_a_sequence_of_its_frames(clip):
    count = len(clip)
    assert count == pytest.approx(1.5 * 25, abs=1) and clip.duration_s == count / 25
    assert clip.displacements.shape == (count, *clip.rest.shape)
    frames = list(clip)
    assert len(frames) == count
    assert np.array_equal(frames[7], clip.rest + clip.displacements[7])
    assert np.array_equal(clip.vertices[7], clip[7]) and np.array_equal(clip[-1], frames[-1])
    with pytest.raises(IndexError):
        clip[count]
    assert clip.head.shape == (count, 3) and clip.gaze.shape == (count, 2, 2)
    assert clip.tongue.shape == (count, 4) and 0.0 <= clip.tongue.min() < clip.tongue.max() <= 1.0


def test_a_voice_moves_the_lips_and_landmarks_go_with_the_skin(clip):
    assert clip.speaks and 2.0 < clip.largest_mm < 40.0
    # The chin is landmark 8. A vertex within some millimetres of it moves as it does.
    chin = clip.landmarks[8]
    nearest = np.argmin(np.linalg.norm(clip.rest - chin, axis=1))
    moved = clip.landmark_displacements[:, 8]
    assert np.abs(moved).max() > 1e-3
    assert np.allclose(moved, clip.displacements[:, nearest], atol=1.5e-3)


def test_arkit_weights_show_most_of_the_motion(clip):
    weights = clip.weights
    assert weights.values.shape == (len(clip), 52) and weights.names[0] == "eyeBlinkLeft"
    assert weights.values.min() >= 0.0 and weights.values.max() <= 1.0
    jaw = weights.values[:, weights.names.index("jawOpen")]
    assert jaw.max() > 0.05 and weights.left_out < 0.5


def test_events_are_read_as_the_command_reads_them(anyface, mesh):
    engine = anyface.Engine(system="cafe-talk")
    sound = spoken(), RATE_HZ
    lines = ["0.4-1.0:left wink", "0.4-1.0:jaw drop:0.5"]
    winks = anyface.animate(mesh, sound, events=lines, engine=engine)
    rests = anyface.animate(mesh, sound, engine=engine)
    assert np.abs(winks.displacements - rests.displacements).max() > 1e-3
    with pytest.raises(anyface.AnyfaceError, match=r"event 2.*not understood"):
        anyface.animate(mesh, sound, events=[lines[0], "0.4-1.0:the blue car"], engine=engine)


def test_the_emotion_that_is_heard_comes_back_and_a_neutral_voice_changes_it(anyface, clip, mesh):
    assert clip.heard_emotion is None
    sound = np.tile(spoken(), 2), RATE_HZ
    alone = anyface.animate(mesh, sound, emotion="auto").heard_emotion
    beside = anyface.animate(mesh, sound, emotion="auto", neutral_voice=sound).heard_emotion
    assert len(alone.time_s) == len(alone.valence) == len(alone.probability["neutral"]) > 2
    assert beside.time_s == alone.time_s and beside.probability != alone.probability
    with pytest.raises(anyface.AnyfaceError, match="neutral voice: expected a voice"):
        silent = np.zeros(2 * RATE_HZ, dtype=np.float32), RATE_HZ
        anyface.animate(mesh, sound, emotion="auto", neutral_voice=silent)


def test_the_mouth_shows_the_sounds_of_a_text(anyface, clip, mesh):
    sound = np.tile(spoken(), 2), RATE_HZ
    heard = anyface.animate(mesh, sound).displacements
    told = anyface.animate(mesh, sound, text="move through a new room").displacements
    assert np.abs(told - heard).max() > 1e-3
    with pytest.raises(anyface.AnyfaceError, match="text: expected words that are said"):
        anyface.animate(mesh, sound, text=" ... ")


def test_arrays_give_what_files_give(anyface, clip, mesh):
    stereo = np.stack([(spoken() * 32767).astype(np.int16)] * 2, axis=1)
    again = anyface.animate(mesh, (stereo, RATE_HZ), fps=25)
    assert again.weights is None
    assert np.array_equal(again.triangles, clip.triangles)
    assert np.abs(again.displacements - clip.displacements).max() < 1e-5


def test_polygons_of_any_length_are_taken(anyface, mesh):
    engine = anyface.Engine()
    inputs = importlib.import_module("anyface.arguments")
    vertices = np.indices((2, 2, 2)).reshape(3, -1).T
    box = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    positions, triangles = inputs.mesh_of((vertices, np.array(box)), engine)
    assert np.array_equal(positions, vertices) and triangles.shape == (12, 3)
    for number, corners in enumerate(box):
        assert set(triangles[2 * number : 2 * number + 2].ravel().tolist()) == set(corners)
    mixed = [[0, 1, 3], [0, 3, 2], *box[1:]]
    _, triangles = inputs.mesh_of((vertices, mixed), engine)
    assert triangles.shape == (12, 3) and triangles[:2].tolist() == mixed[:2]


def test_a_head_with_other_axes_moves_the_same_way(anyface, clip, mesh, voice):
    # +y up and +z forward become +z up and -y forward.
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], dtype=np.float32)
    turned = (mesh[0] @ turn.T, mesh[1])
    again = anyface.animate(turned, voice, fps=25, forward="-y", up="+z")
    assert np.abs(again.displacements - clip.displacements @ turn.T).max() < 2e-4


def test_emotion_controls_and_seed_change_the_motion(anyface, clip, voice):
    happy = anyface.animate(HEAD, voice, fps=25, emotion="happy:1")
    assert np.abs(happy.displacements - clip.displacements).max() > 1e-3
    late = anyface.animate(HEAD, voice, fps=25, emotion=[(0.0, "neutral:0"), (1.4, "happy:1")])
    quiet = np.abs(late.displacements - clip.displacements).max(axis=(1, 2))
    assert quiet[3] < quiet[30]
    still = anyface.animate(HEAD, voice, fps=25, emotion="off", controls={"articulation": 0.0})
    assert still.largest_mm < 0.25 * clip.largest_mm
    keys = {"articulation": ([0.0, 1.4], [0.0, 2.0])}
    rising = anyface.animate(HEAD, voice, fps=25, emotion="off", controls=keys)
    assert rising.largest_mm > still.largest_mm


def test_landmarks_are_found_and_may_be_given_back(anyface, clip, voice):
    landmarks = anyface.find_landmarks(HEAD)
    assert landmarks.positions.shape == (68, 3) and landmarks.confidence.min() > 0.0
    assert landmarks.mouth in ("open", "slit", "welded")
    again = anyface.animate(HEAD, voice, fps=25, landmarks=landmarks.vertices)
    assert np.linalg.norm(again.landmarks - clip.landmarks, axis=1).max() < 5e-3
    nose = landmarks.positions[30] + np.array([0.002, 0.0, 0.0], dtype=np.float32)
    pinned = anyface.find_landmarks(HEAD, fixed={30: nose})
    assert np.linalg.norm(pinned.positions[30] - nose) < 2e-3


def test_a_rig_has_all_shapes(anyface):
    rig = anyface.make_rig(HEAD)
    assert len(rig.names) == len(rig.vectors) == 67
    assert np.abs(rig.vectors[rig.names.index("jawOpen")]).max() > 5e-3


def test_a_rig_is_written_as_an_avatar(anyface, tmp_path):
    rig = anyface.make_rig(HEAD, out=tmp_path / "head.vrm")
    assert len(rig.names) == 67
    whole = (tmp_path / "head.vrm").read_bytes()
    document = json.loads(whole[20 : 20 + int.from_bytes(whole[12:16], "little")])
    expressions = document["extensions"]["VRMC_vrm"]["expressions"]
    assert {"aa", "blink", "happy", "lookUp"} <= expressions["preset"].keys()
    assert len(expressions["custom"]) == 52


def test_a_take_is_written_for_avatars(anyface, voice, tmp_path):
    clip = anyface.animate(HEAD, voice, out=tmp_path / "talk.vrma")
    assert len(clip) > 1
    whole = (tmp_path / "talk.vrma").read_bytes()
    document = json.loads(whole[20 : 20 + int.from_bytes(whole[12:16], "little")])
    take = document["extensions"]["VRMC_vrm_animation"]
    assert {"aa", "ou", "blink"} <= take["expressions"]["preset"].keys()
    assert "JawOpen" in take["expressions"]["custom"] and "lookAt" in take


def test_progress_tells_stages_and_cancel_stops(anyface, mesh, voice, tmp_path):
    # Nothing is cached for the mesh, so the search for its landmarks takes a while.
    engine, reports = anyface.Engine(cache=tmp_path), []

    def animate(cancel):
        calls = {"progress": lambda *at: reports.append(at), "cancel": lambda: cancel}
        anyface.animate(mesh, voice, engine=engine, **calls)

    with pytest.raises(anyface.Cancelled) as caught:
        animate(cancel=True)
    assert caught.value.kind == "cancelled"
    animate(cancel=False)
    stages = {stage for stage, _ in reports}
    assert stages & {"landmarks", "weights", "speech", "deform"}
    assert all(0.0 <= share <= 1.0 for _, share in reports)


def test_what_the_caller_raises_ends_the_work(anyface, mesh, voice):
    new = (mesh[0] * np.float32(0.987), mesh[1])

    def stop(stage, share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        anyface.animate(new, voice, progress=stop)
    assert not [thread for thread in threading.enumerate() if thread.name == "anyface"]


SOUND = (np.zeros(16000, dtype=np.float32), 16000)


@pytest.mark.parametrize(
    ("kind", "words", "mesh", "sound", "more"),
    [
        ("file", "nowhere.obj", "nowhere.obj", SOUND, {}),
        ("file", "nowhere.wav", HEAD, "nowhere.wav", {}),
        ("input", r"mesh: expected a path or \(vertices, faces\), got int", 7, SOUND, {}),
        ("input", r"expected \[V, 3\], got \[4, 2\]", (np.ones((4, 2)), [[0, 1, 2]]), SOUND, {}),
        ("input", "expected 0 to 3, got 1 to 4", (np.ones((4, 3)), [[1, 2, 4]]), SOUND, {}),
        ("input", "expected whole numbers", (np.ones((4, 3)), np.ones((1, 3))), SOUND, {}),
        ("input", r"\[S\] or \[S, C\], got \[2, 99\]", HEAD, (np.ones((2, 99)), 16000), {}),
        ("audio", "4000", HEAD, (np.ones(100), 16), {}),
        ("input", "expected one of neutral", HEAD, SOUND, {"emotion": "joyful"}),
        ("input", "articulation", HEAD, SOUND, {"controls": {"loudness": 1.0}}),
        ("input", "articulation", HEAD, SOUND, {"controls": {"articulation": 99.0}}),
        ("input", r"\+x, -x, .* got 'left'", HEAD, SOUND, {"forward": "left"}),
        ("input", r"\[68, 3\] or .* \[68\], got \[5\]", HEAD, SOUND, {"landmarks": range(5)}),
        ("input", "fps", HEAD, SOUND, {"fps": 0.0}),
    ],
)
def test_errors_say_what_was_expected_and_what_came(anyface, kind, words, mesh, sound, more):
    with pytest.raises(anyface.AnyfaceError, match=words) as caught:
        anyface.animate(mesh, sound, **more)
    assert caught.value.kind == kind


def test_the_library_refuses_a_mesh_in_its_own_words(anyface):
    grain = (np.eye(3), [[0, 1, 2]])
    words = "expected at least 4 triangles, got 1"
    with pytest.raises(anyface.AnyfaceError, match=words) as caught:
        anyface.find_landmarks(grain)
    assert caught.value.kind == "mesh"


def test_a_performer_is_learned_from_files_and_shown(anyface, mesh, tmp_path):
    samples = spoken(8.0)
    sound, motion, out = tmp_path / "a.wav", tmp_path / "a.npz", tmp_path / "kim.performer"
    write_wav(sound, samples)
    plain = {"emotion": "off", "fps": 25.0}
    still = {"blinks_per_minute": 0.0, "noise": 0.0}
    person = anyface.animate(mesh, sound, controls=still | {"width": 2.0, "jaw": 1.6}, **plain)
    # In the units of the mesh, which its landmarks at rest tell.
    np.savez(motion, landmark_displacements=person.landmark_displacements, fps=25.0,
             landmarks_neutral=person.landmarks)  # fmt: skip
    card = anyface.learn_performer([(sound, motion)], out)
    scores = {score["name"]: score for score in card["scores"]}
    width = scores["width"]
    assert width["r"] > width["r_without"] - 0.1 and card["encoder"]
    assert abs(1 - width["slope"]) < abs(1 - width["slope_without"])
    kim = anyface.animate(mesh, sound, controls=still, performer=out, **plain)
    alone = anyface.animate(mesh, sound, controls=still, **plain)
    width = [np.ptp(clip.landmark_displacements[:, 54, 0]) for clip in (kim, alone)]
    assert width[0] > 1.05 * width[1]
    with pytest.raises(anyface.AnyfaceError, match=r"gone\.npz"):
        anyface.learn_performer([(sound, tmp_path / "gone.npz")], out)
