"""Readers of published corpora, on made-up files of the same layout."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
import soundfile

from training.align import canonical_landmarks
from training.corpus.__main__ import main
from training.corpus.check import check
from training.corpus.checked import CorpusError
from training.corpus.folder import CorpusFolder
from training.corpus.folder_clips import clips
from training.corpus.kalman import filter_track, noise_variances
from training.corpus.readers import READERS
from training.corpus.readers.flame import EXPRESSION, Flame, label_of, read_flame
from training.corpus.readers.tables import NumbersAlone, read_pickle, read_ply
from training.tests.made_up import face_mesh, follow, opening, spoken, talking

SECONDS = 2.0
VERTICES, TRIANGLES = face_mesh()


def sound(path: Path, rate_hz: int = 16000) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    soundfile.write(path, at_rate(rate_hz), rate_hz)


def at_rate(rate_hz: int) -> np.ndarray:
    """The made-up voice at a rate."""
    samples = spoken(SECONDS, 1)
    times = np.arange(int(SECONDS * rate_hz)) / rate_hz
    return np.interp(times, np.arange(len(samples)) / 16000, samples)


def ply(path: Path, vertices: np.ndarray, binary: bool = True) -> None:
    """A mesh with the made-up triangles."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kind = "binary_little_endian" if binary else "ascii"
    head = f"ply\nformat {kind} 1.0\nelement vertex {len(vertices)}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(TRIANGLES)}\nproperty list uchar int vertex_indices\nend_header\n"
    if binary:
        faces = np.zeros(len(TRIANGLES), [("n", "u1"), ("v", "<i4", 3)])
        faces["n"], faces["v"] = 3, TRIANGLES
        path.write_bytes(head.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())
    else:
        rows = [" ".join(map(str, v)) for v in vertices] + [f"3 {a} {b} {c}" for a, b, c in TRIANGLES]
        path.write_text(head + "\n".join(rows) + "\n")


def obj(path: Path, vertices: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["v {} {} {}".format(*v) for v in vertices] + ["f {} {} {}".format(*(t + 1)) for t in TRIANGLES]
    path.write_text("\n".join(lines) + "\n")


def templates(source: Path, *speakers: str) -> None:
    (source / "templates.pkl").write_bytes(pickle.dumps({name: VERTICES for name in speakers}))


def frames(fps: float) -> np.ndarray:
    return follow(talking(SECONDS, 1, fps))


EMOVOCA = [
    ("FaceTalk_170728_03272_TA", "Afraid", 0, 1), ("FaceTalk_170728_03272_TA", "Irritated1", 2, 1),
    ("FaceTalk_170728_03272_TA", "Sad1", 3, 2), ("FaceTalk_170809_00138_TA", "Smile2", 4, 3),
    ("FaceTalk_170809_00138_TA", "Drunk2", 5, 3), ("FaceTalk_170809_00138_TA", "Moody", 7, 2),
]  # fmt: skip
"""Speaker, expression, its number in EmoVOCA, and level."""
TA, HELD = "FaceTalk_170728_03272_TA", "FaceTalk_170809_00138_TA"


def vocaset_published(source: Path) -> None:
    ply(source / "template/FLAME_sample.ply", VERTICES)
    for speaker in (TA, HELD):
        sound(source / f"audio/{speaker}/sentence01.wav", 22000)
        for number, frame in enumerate(frames(60.0)):
            ply(source / f"unposedcleaneddata/{speaker}/sentence01/sentence01.{number:06d}.ply", frame)


def vocaset_arrays(source: Path) -> None:
    ply(source / "FLAME_sample.ply", VERTICES, binary=False)
    values = np.concatenate([frames(60.0)] * 2).astype(np.float32)
    np.save(source / "data_verts.npy", values)
    half = len(values) // 2
    first, second = ({i: start + i for i in range(half)} for start in (0, half))
    index = {TA: {"sentence01": first}, HELD: {"sentence02": second}}
    said = {"audio": (2**15 * at_rate(22000)).astype(np.int16), "sample_rate": 22000}
    sounds = {TA: {"sentence01": said}, HELD: {"sentence02": said}}
    for name, value in (("subj_seq_to_idx", index), ("raw_audio_fixed", sounds)):
        (source / f"{name}.pkl").write_bytes(pickle.dumps(value, protocol=2))
    templates(source, TA, HELD)


def flat(source: Path, names: list[str], fps: float, scale: float, place: str = "vertices_npy") -> None:
    """NAME.npy [T, 3 V] and wav/NAME.wav, and one of each without a partner: loaders leave those out."""
    (source / place).mkdir()
    for name in names:
        np.save(source / place / f"{name}.npy", scale * frames(fps).reshape(-1, VERTICES.size))
        sound(source / f"wav/{name}.wav")
    np.save(source / place / f"{names[0]}0.npy", np.zeros((9, VERTICES.size)))
    sound(source / f"wav/{names[0]}1.wav")


def vocaset_flat(source: Path, fps: float = 60.0) -> None:
    """As process_voca_data.py of FaceFormer, CodeTalker and SelfTalk writes it: all frames."""
    ply(source / "templates/FLAME_sample.ply", VERTICES)
    flat(source, [f"{TA}_sentence01", f"{HELD}_sentence01"], fps, 1.0)
    templates(source, TA, HELD)


def vocaset_halved(source: Path) -> None:
    vocaset_flat(source, 30.0)


def biwi(source: Path) -> None:
    ply(source / "templates/BIWI.ply", 5.0 * VERTICES)
    flat(source, ["F2_e01", "F2_01", "M3_34", "M3_38", "F7_01"], 25.0, 5.0)
    shown = {n: 5.0 * VERTICES.reshape(-1) for n in ("F2", "M3", "F7")}
    (source / "templates.pkl").write_bytes(pickle.dumps(shown))


def biwi6(source: Path) -> None:
    """As ScanTalk reads it."""
    flat(source, ["F2_01", "F2_e01", "F7_38", "M6_01"], 25.0, 5.0, "vertices")
    for speaker in ("F2", "F7", "M6"):
        obj(source / f"templates/{speaker}.obj", 5.0 * VERTICES)


def multiface_flat(source: Path) -> None:
    """As ScanTalk reads it."""
    names = ["20180227_SEN_a_good_morrow", "20190828_SEN_a_good_morrow", "20181017_SEN_a_good_morrow"]
    flat(source, names, 30.0, 5.0, "vertices")
    for name in names:
        ply(source / f"templates/{name.split('_')[0]}.ply", 5.0 * VERTICES)


def multiface(source: Path) -> None:
    """As published: every third number of a frame, a pose of the head beside each."""
    person = source / "m--20180227--0000--6795937--GHS"
    for take in ("E001_Neutral_Eyes_Open", *(f"SEN_{i}" for i in range(10))):
        for number, frame in enumerate(1000.0 * frames(30.0)):
            path = person / f"tracked_mesh/{take}/{3 * number + 102:06d}.obj"
            obj(path, frame) if number == 0 or take == "SEN_1" else None
            if take != "SEN_1":
                path.parent.mkdir(parents=True, exist_ok=True)
                frame.astype(np.float32).tofile(path.with_suffix(".bin"))
            path.with_name(f"{path.stem}_transform.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n")
        if take.startswith("SEN"):
            sound(person / f"audio/{take}.wav")


def ravdess(source: Path) -> None:
    mead(source, 30.0)
    for old, new in (
        ("happy_level_2_001", "03-01-03-02-01-01-12"),
        ("neutral_level_1_001", "03-01-01-01-01-01-24"),
    ):
        actor = source / f"Actor_{new[-2:]}"
        actor.mkdir()
        for ending in ("npz", "wav"):
            (source / f"M003/{old}.{ending}").rename(actor / f"{new}.{ending}")


def mead(source: Path, fps: float = 25.0) -> None:
    count = int(SECONDS * fps)
    random = np.random.default_rng(0)
    directions = np.zeros((len(VERTICES), 3, EXPRESSION + 100))
    directions[..., EXPRESSION] = 1e-3 * random.standard_normal(VERTICES.shape)
    regressor = scipy.sparse.csc_matrix(np.full((5, len(VERTICES)), 1.0 / len(VERTICES)))
    skinning = np.zeros((len(VERTICES), 5))
    skinning[:, 2] = VERTICES[:, 1] < 0.0
    model = {"v_template": VERTICES, "f": TRIANGLES.astype(np.uint32), "shapedirs": directions,
             "posedirs": np.zeros((len(VERTICES), 3, 36)), "J_regressor": regressor,
             "weights": skinning}  # fmt: skip
    (source / "generic_model.pkl").write_bytes(pickle.dumps(model, protocol=2))
    open_ = opening(np.arange(count) / fps, 1)
    jaw, pose = 0.2 * open_[:, None] * [[1.0, 0.0, 0.0]], np.zeros((count, 6))
    pose[:, 3:] = jaw
    (source / "M003").mkdir()
    shown = {"exp": 0.1 * random.random((count, 50)), "jaw": jaw, "shape": np.zeros(100)}
    np.savez(source / "M003/happy_level_2_001.npz", **shown)
    shown = {"exp": np.zeros((count, 50)), "pose": pose, "shape": np.zeros((1, 100))}
    np.savez(source / "M003/neutral_level_1_001.npz", **shown)
    for name in ("happy_level_2_001", "neutral_level_1_001"):
        sound(source / f"M003/{name}.wav")


def emovoca(source: Path, fps: float = 60.0) -> None:
    """As emovoca_generator.py writes it."""
    ply(source / "template/flame_model/FLAME_sample.ply", VERTICES)
    templates(source, TA, HELD)
    folders = ("sequences", "label", "intensity", "landmarks_sequences")
    for folder in folders:
        (source / folder).mkdir()
    for speaker, label, number, level in EMOVOCA:
        name = f"{speaker}_sentence01_{label}_{level}"
        values = (frames(fps), np.array(number), np.array(level), np.zeros((9, 68, 3)))
        for folder, value in zip(folders, values, strict=True):
            np.save(source / folder / f"{name}.npy", value)
        sound(source / f"wav/{name}.wav")


def emovoca_plain(source: Path) -> None:
    """Sequences beside the sounds of VOCASET."""
    ply(source / "FLAME_sample.ply", VERTICES)
    templates(source, TA, HELD)
    for speaker, label in ((TA, "happy_1"), (TA, "sad_3"), (HELD, "angry_2")):
        np.save(source / f"{speaker}_sentence01_{label}.npy", frames(30.0))
        sound(source / f"audio/{speaker}_sentence01.wav")


def beat(source: Path) -> None:
    times = np.arange(120) / 60.0
    open_ = opening(times, 1)
    for number in range(10):
        name = f"1_wayne_0_{number}_{number}"
        shown = [{"weights": [float(o), 0.0, 0.1], "time": float(t), "rotation": []}
                 for o, t in zip(open_, times, strict=True)]  # fmt: skip
        content = {"names": ["jawOpen", "tongueOut", "mouthSmileLeft"], "frames": shown}
        (source / "1").mkdir(exist_ok=True)
        (source / f"1/{name}.json").write_text(json.dumps(content))
        (source / f"1/{name}.txt").write_text("hello\tworld")
        sound(source / f"1/{name}.wav")


def live_link_face(source: Path) -> None:
    lines = ["Timecode,BlendshapeCount,EyeBlinkLeft,JawOpen,TongueOut,HeadYaw,LeftEyePitch"]
    for number, height in enumerate(opening(np.arange(120) / 60.0, 1)):
        code = f"10:59:{59 if number < 60 else 60:02d}:{number % 60:02d}.120".replace("10:59:60", "11:00:00")
        lines += [f"{code},61,0.1,{height:.5f},0,0.01,0.02"] * (2 if number == 7 else 1)
    take = source / "20260101_MySlate_1"
    take.mkdir()
    (take / "MySlate_1_iPhone.csv").write_text("\n".join(lines) + "\n")
    (take / "MySlate_1_iPhone_raw.csv").write_text("nothing")
    sound(take / "MySlate_1_iPhone.wav")


def openface(source: Path) -> None:
    axes = [f" {axis}_{i}" for axis in "XYZ" for i in range(68)]
    lines = [",".join(["frame", " timestamp", " confidence", " success", *axes])]
    camera = 1000.0 * talking(SECONDS, 1, 30.0) * [1.0, -1.0, -1.0] + [20.0, -30.0, 600.0]
    for number, places in enumerate(camera):
        tracked = number not in (3, 4)
        head = [str(number + 1), f"{number / 30.0:.4f}", "0.98" if tracked else "0.1", str(int(tracked))]
        lines.append(",".join([*head, *(f"{x:.2f}" for x in places.T.flatten())]))
    for name in ("one", "two"):
        sound(source / f"eve/{name}.wav")
        (source / f"eve/{name}.csv").write_text("\n".join(lines) + "\n")


CASES = {
    "vocaset published": ("vocaset", vocaset_published, {TA: "train", HELD: "test"}, "vertices", 120),
    "vocaset for training": ("vocaset", vocaset_arrays, {TA: "train", HELD: "test"}, "vertices", 120),
    "vocaset of FaceFormer": ("vocaset", vocaset_flat, {TA: "train", HELD: "test"}, "vertices", 120),
    "vocaset, halved": ("vocaset", vocaset_halved, {TA: "train", HELD: "test"}, "vertices", 60),
    "biwi": ("biwi", biwi, {"F2": "train", "F7": "test"}, "vertices", 50),
    "biwi of ScanTalk": ("biwi", biwi6, {"F2": "train", "F7": "val", "M6": "test"}, "vertices", 50),
    "multiface": ("multiface", multiface, {}, "vertices", 60),
    "multiface of ScanTalk": ("multiface", multiface_flat, {}, "vertices", 60),
    "mead": ("mead", mead, {"M003": "train"}, "vertices", 50),
    "ravdess": ("ravdess", ravdess, {"actor12": "train", "actor24": "test"}, "vertices", 60),
    "emovoca": ("emovoca", emovoca, {TA: "train", HELD: "test"}, "vertices", 120),
    "emovoca beside vocaset": ("emovoca", emovoca_plain, {TA: "train", HELD: "test"}, "vertices", 60),
    "beat": ("beat", beat, {}, "weights", 120),
    "live link face": ("live_link_face", live_link_face, {"phone": "train"}, "weights", 120),
    "openface": ("openface", openface, {"eve": "train"}, "landmarks", 60),
}


def converted(tmp_path: Path, name: str) -> CorpusFolder:
    """The made-up corpus as a folder."""
    kind, make = CASES[name][:2]
    source, marks = tmp_path / "source", tmp_path / "landmarks.json"
    source.mkdir()
    make(source)
    marks.write_text(json.dumps({"vertices": list(range(68))}))
    assert main(["convert", kind, str(source), str(tmp_path / "out"), "--landmarks", str(marks)]) == 0
    return CorpusFolder(tmp_path / "out")


@pytest.mark.parametrize("name", CASES)
def test_a_corpus_becomes_a_folder(tmp_path, name, capsys):
    _, _, splits, kind, count = CASES[name]
    folder = converted(tmp_path, name)
    assert all(splits.get(row.speaker, row.split) == row.split for row in folder.rows)
    track = getattr(folder, kind)(folder.rows[0])
    assert len(track.values) == count
    report = check(folder.path)
    assert report.errors == [] and report.kinds[kind] == len(folder.rows)
    assert not any("wide" in odd or "exchanged" in odd for odd in report.odd), report.odd
    motion = clips(folder)[0].motion
    drop = motion[:, 8, 1] - motion[0, 8, 1]
    assert -0.05 < drop.min() < -1e-3
    assert "can train: systems.freetalk.train" in capsys.readouterr().out


WIDE = "m--20180227--0000--6795937--GHS"
PUBLIC = {
    "vocaset published": (60.0, {f"{TA}_sentence01": "train", f"{HELD}_sentence01": "test"}),
    "vocaset for training": (60.0, {f"{TA}_sentence01": "train", f"{HELD}_sentence02": "test"}),
    "vocaset of FaceFormer": (60.0, {f"{TA}_sentence01": "train", f"{HELD}_sentence01": "test"}),
    "vocaset, halved": (30.0, {f"{TA}_sentence01": "train", f"{HELD}_sentence01": "test"}),
    "biwi": (25.0, {"F2_01": "train", "F2_e01": "train unknown", "M3_34": "val", "M3_38": "test",
                    "F7_01": "test"}),
    "biwi of ScanTalk": (25.0, {"F2_01": "train", "F2_e01": "train unknown", "F7_38": "val",
                                "M6_01": "test"}),
    "multiface": (30.0, {f"{WIDE}_SEN_{i}": "train" if i < 9 else "test" for i in range(10)}),
    "multiface of ScanTalk": (30.0, {"20180227_SEN_a_good_morrow": "train",
                                     "20190828_SEN_a_good_morrow": "val",
                                     "20181017_SEN_a_good_morrow": "test"}),
    "mead": (25.0, {"M003_happy_level_2_001": "train happy 0.667", "M003_neutral_level_1_001": "train"}),
    "ravdess": (30.0, {"Actor_12_03-01-03-02-01-01-12": "train happy 1",
                       "Actor_24_03-01-01-01-01-01-24": "test"}),
    "emovoca": (60.0, {f"{TA}_sentence01_Afraid_1": "train afraid 0.333",
                       f"{TA}_sentence01_Irritated1_1": "train angry 0.333",
                       f"{TA}_sentence01_Sad1_2": "train sad 0.667",
                       f"{HELD}_sentence01_Smile2_3": "test happy 1",
                       f"{HELD}_sentence01_Drunk2_3": "test drunk 1",
                       f"{HELD}_sentence01_Moody_2": "test upset 0.667"}),
    "emovoca beside vocaset": (30.0, {f"{TA}_sentence01_happy_1": "train happy 0.333",
                                      f"{TA}_sentence01_sad_3": "train sad 1",
                                      f"{HELD}_sentence01_angry_2": "test angry 0.667"}),
}  # fmt: skip
"""For each layout the frame rate, and the clips that the code which published it reads from the same files,
with split, emotion and intensity (if none is given, neutral 0)."""


@pytest.mark.parametrize("name", PUBLIC)
def test_a_corpus_is_read_as_the_code_reads_it_that_published_it(tmp_path, name):
    fps, expected = PUBLIC[name]
    folder = converted(tmp_path, name)
    facts = {row.clip: f"{row.split} {row.emotion} {row.intensity:g}" for row in folder.rows}
    defaults = ("train", "neutral", "0")
    said = {clip: text.split() for clip, text in expected.items()}
    assert facts == {clip: " ".join([*words, *defaults[len(words) :]]) for clip, words in said.items()}
    assert folder.fps["vertices"] == fps
    for row in folder.rows:
        seconds = len(folder.vertices(row).values) / fps
        assert abs(seconds - len(folder.sound(row)) / 16000) < 0.05, row.clip


def test_labels_come_from_names():
    assert label_of("M003_front_happy_level_2_001") == ("happy", 0.667)
    assert label_of("_disgusted_3") == ("disgusted", 1.0)
    assert label_of("M003_neutral_level_1_001") == ("neutral", 0.0)
    assert label_of("M003_001") == ("unknown", 0.0)
    assert label_of("_Irritated1_2") == ("angry", 0.667)
    assert label_of("_Ashamed_3") == ("ashamed", 1.0)


def test_names_of_ravdess_say_who_says_what_and_how(tmp_path):
    folder = converted(tmp_path, "ravdess")
    rows = {row.speaker: row for row in folder.rows}
    assert (rows["actor12"].emotion, rows["actor12"].intensity) == ("happy", 1.0)
    assert (rows["actor24"].emotion, rows["actor24"].intensity) == ("neutral", 0.0)
    assert rows["actor12"].text == "Kids are talking by the door"
    assert folder.fps["vertices"] == 30.0


@pytest.mark.parametrize("name,clip,smooth", [
    ("ravdess", "Actor_12/03-01-03-02-01-01-12", filter_track),
    ("mead", "M003/happy_level_2_001", lambda track: track),
])  # fmt: skip
def test_parameters_of_ravdess_are_filtered_and_those_of_mead_are_not(tmp_path, name, clip, smooth):
    folder = converted(tmp_path, name)
    happy = next(row for row in folder.rows if row.emotion == "happy")
    tracked = np.load(tmp_path / f"source/{clip}.npz")
    flame = read_flame(tmp_path / "source/generic_model.pkl")
    expected = flame.vertices(tracked["shape"], smooth(tracked["exp"]), smooth(tracked["jaw"]))
    np.testing.assert_allclose(folder.vertices(happy).values, expected, atol=1e-6)
    # The expressions of the made-up corpus are noise, so that filtering them is seen.
    unfiltered = flame.vertices(tracked["shape"], tracked["exp"], tracked["jaw"])
    assert (np.abs(expected - unfiltered).max() > 1e-5) == (name == "ravdess")


def test_the_filter_brings_a_track_nearer_to_the_truth_and_leaves_a_smooth_one():
    random = np.random.default_rng(0)
    for shake in (0.5, 2.0):
        pushed = random.standard_normal((2000, 3))
        # The model's own motion: an acceleration that stays for a frame.
        velocity = np.cumsum(pushed, axis=0) - pushed
        truth = np.cumsum(velocity + 0.5 * pushed, axis=0)
        seen = truth + shake * random.standard_normal(truth.shape)
        acceleration, noise = noise_variances(seen)
        np.testing.assert_allclose(noise, shake**2, rtol=0.35)
        np.testing.assert_allclose(acceleration, 1.0, rtol=0.9)
        near = (filter_track(seen) - truth)[20:].std()
        assert near < 0.95 * (seen - truth)[20:].std(), shake
    smooth = np.sin(np.arange(90)[:, None] / [4.0, 9.0, 20.0])
    assert np.array_equal(filter_track(smooth), smooth)
    shaken = smooth + 0.1 * random.standard_normal(smooth.shape)
    assert (filter_track(shaken) - smooth)[5:].std() < 0.095


def test_repeated_timecodes_are_dropped_and_minutes_carried(tmp_path):
    folder = converted(tmp_path, "live link face")
    seconds = folder.weights(folder.rows[0]).seconds
    np.testing.assert_allclose(np.diff(seconds), 1 / 60, atol=1e-5)


def test_openface_turns_the_camera_and_marks_lost_frames(tmp_path):
    folder = converted(tmp_path, "openface")
    track = folder.landmarks(folder.rows[0])
    assert list(np.flatnonzero(~track.tracked_frames)) == [3, 4]
    shape = track.values[0] - track.values[0, 30]
    truth = talking(SECONDS, 1, 30.0)[0]
    np.testing.assert_allclose(shape, truth - truth[30], atol=2e-5)


def test_flame_turns_the_jaw_about_its_joint():
    regressor, skinning = np.zeros((5, 3)), np.zeros((3, 5))
    regressor[2, 0], skinning[1:, 2] = 1.0, [1.0, 0.5]
    vertices = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    flame = Flame(vertices, TRIANGLES, np.zeros((3, 3, 400)), np.zeros((3, 3, 36)), regressor, skinning)
    moved = flame.vertices(np.zeros(10), np.zeros((1, 50)), np.array([[np.pi / 2, 0.0, 0.0]]))[0]
    np.testing.assert_allclose(moved, [[0, 1, 0], [0, 0, 0], [0, 0.5, 0.5]], atol=1e-12)


def test_a_pickle_that_runs_programs_is_refused(tmp_path):
    (tmp_path / "bad.pkl").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(CorpusError, match="a pickle of numbers alone, found os.system"):
        read_pickle(tmp_path / "bad.pkl")
    assert NumbersAlone is not pickle.Unpickler


@pytest.mark.parametrize("kind", READERS)
def test_an_empty_folder_is_an_error_that_says_what_is_expected(tmp_path, kind, capsys):
    (tmp_path / "source").mkdir()
    marks = tmp_path / "landmarks.json"
    marks.write_text("{}")
    flags = ["convert", kind, str(tmp_path / "source"), str(tmp_path / "out"), "--landmarks", str(marks)]
    assert main(flags) == 1
    assert "expected" in capsys.readouterr().err


def test_landmarks_of_the_topology_are_asked_for(tmp_path, capsys):
    vocaset_flat(tmp_path)
    assert main(["convert", "vocaset", str(tmp_path), str(tmp_path / "out")]) == 1
    assert "--landmarks FILE" in capsys.readouterr().err


def test_a_broken_ply_is_told(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"nothing")
    with pytest.raises(CorpusError, match="expected ply"):
        read_ply(tmp_path / "a.ply")
    assert canonical_landmarks().shape == (68, 3)
