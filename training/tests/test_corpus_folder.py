"""Corpus folders: a sound one, and many bad ones; each error names file, row, expected and actual value."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import soundfile

from training.align import canonical_landmarks
from training.corpus.check import check
from training.corpus.checked import CorpusError
from training.corpus.clip import inner_gap
from training.corpus.folder import CorpusFolder
from training.corpus.folder_clips import arkit_modes, clips
from training.corpus.mirror import permutation
from training.tests.made_up import made_up, opening, spoken, talking

SECONDS = 12.0
SPIN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    """A folder of each kind of motion; read only."""
    root = tmp_path_factory.mktemp("corpora")
    return {kind: made_up(root / kind, SECONDS, kind) for kind in ("landmarks", "weights", "vertices")}


@pytest.fixture
def copy(folders, tmp_path):
    """A copy of a folder that may be spoilt."""
    return lambda kind: Path(shutil.copytree(folders[kind], tmp_path / kind))


def edit(path: Path, old: str, new: str) -> None:
    """Replaces the first `old`, which must be there."""
    text = path.read_text()
    assert old in text, text[:200]
    path.write_text(text.replace(old, new, 1))


def array(path: Path, change) -> None:
    """Changes the arrays of an .npz."""
    arrays = dict(np.load(path))
    np.savez(path, **change(arrays))


def spoil_frame(path: Path) -> None:
    vertices = np.load(path)
    vertices[70, 5, 1] = np.nan
    np.save(path, vertices)


def deaf(path: Path) -> None:
    for kind in ("landmarks",):
        shutil.rmtree(path / kind)


def table(rows: list[int]):
    """Writes a table of landmarks."""
    return lambda p: (p / "topologies/ball/landmarks.json").write_text(json.dumps({"vertices": rows}))


TSV, FIRST = "clips.tsv", "ann_0\tann\ttrain\thappy\t1\tba ba"
LAND, CSV, PHONES = "landmarks/ann_0.npz", "weights/ann_0.csv", "phones/ann_0.tsv"
OBJ, MARKS = "topologies/ball/neutral.obj", "topologies/ball/landmarks.json"


def said(lines: str):
    """Writes phones of the first clip."""

    def write(p: Path) -> None:
        (p / "phones").mkdir()
        (p / PHONES).write_text("start_s\tduration_s\tphone\n" + lines)

    return write


BAD = {
    "no clips.tsv": ("landmarks", lambda p: (p / TSV).unlink(), [TSV, "a file", "none"]),
    "no corpus.json": ("landmarks", lambda p: (p / "corpus.json").unlink(),
                       ["corpus.json", "a file", "none"]),
    "corpus.json is no json": ("landmarks", lambda p: (p / "corpus.json").write_text("{\n'a'}"),
                               ["corpus.json, row 2", "json", "property name"]),
    "unknown unit": ("landmarks", lambda p: edit(p / "corpus.json", '"m"', '"inch"'),
                     ["corpus.json", "unit: m, cm or mm", "inch"]),
    "unknown head": ("landmarks", lambda p: edit(p / "corpus.json", "still", "fixed"),
                     ["corpus.json", "moves or still", "fixed"]),
    "wild rate": ("landmarks", lambda p: edit(p / "corpus.json", "25.0", "0"),
                  ["corpus.json", "fps of vertices: 1 to 1000", "0"]),
    "missing column": ("landmarks", lambda p: edit(p / TSV, "emotion", "mood"),
                       ["clips.tsv, row 1", "columns clip, speaker", "no emotion"]),
    "no rows": ("landmarks", lambda p: (p / TSV).write_text(TSV_HEAD),
                ["clips.tsv, row 2", "a clip", "no rows"]),
    "a cell too few": ("landmarks", lambda p: edit(p / TSV, FIRST, FIRST[:-6]),
                       ["clips.tsv, row 2", "6 cells", "found 5"]),
    "a clip twice": ("landmarks", lambda p: edit(p / TSV, "ann_1", "ann_0"),
                     ["clips.tsv, row 3", "a new clip", "ann_0 of row 2"]),
    "a clip elsewhere": ("landmarks", lambda p: edit(p / TSV, "ann_0", "../ann_0"),
                         ["clips.tsv, row 2", "a name without /", "../ann_0"]),
    "unknown split": ("landmarks", lambda p: edit(p / TSV, "train", "training"),
                      ["clips.tsv, row 2", "train, val, test", "'training'"]),
    "unknown emotion": ("landmarks", lambda p: edit(p / TSV, "happy", "hapy"),
                        ["clips.tsv, row 2", "happy", "'hapy'"]),
    "intensity is a word": ("landmarks", lambda p: edit(p / TSV, "happy\t1", "happy\tstrong"),
                            ["clips.tsv, row 2", "intensity: a number", "'strong'"]),
    "intensity in percent": ("landmarks", lambda p: edit(p / TSV, "happy\t1", "happy\t80"),
                             ["clips.tsv, row 2", "intensity: 0 to 1.5", "80"]),
    "sound is missing": ("landmarks", lambda p: (p / "audio/ann_0.wav").unlink(),
                         ["clips.tsv, row 2", "audio/ann_0 with one of .wav", "no such file"]),
    "sound is none": ("landmarks", lambda p: (p / "audio/ann_0.wav").write_bytes(b"RIFFxxxx"),
                      ["ann_0.wav", "expected sound", "found"]),
    "sound is short": ("landmarks", lambda p: soundfile.write(p / "audio/ann_0.wav", np.zeros(99), 16000),
                       ["ann_0.wav", "0.3 s", "0.01 s"]),
    "telephone": ("landmarks", lambda p: soundfile.write(p / "audio/ann_0.wav", np.zeros(9999), 8000),
                  ["ann_0.wav", "16000", "8000"]),
    "66 landmarks": ("landmarks", lambda p: array(p / LAND, lambda a: a | {
                         "landmarks": a["landmarks"][:, :66]}),
                     ["ann_0.npz", "landmarks [T, 68, 3]", "[300, 66, 3]"]),
    "NaN": ("landmarks", lambda p: array(p / LAND, lambda a: a | {"landmarks": a["landmarks"] + hole(70)}),
            ["ann_0.npz, row 70", "finite numbers", "NaN"]),
    "no rate": ("landmarks", lambda p: array(p / LAND, lambda a: {"landmarks": a["landmarks"]}),
                ["ann_0.npz", "fps.landmarks in corpus.json", "none"]),
    "found of another length": ("landmarks", lambda p: array(p / LAND, lambda a: a | {"found": np.ones(7)}),
                                ["ann_0.npz", "found of shape (300,)", "(7,)"]),
    "not an archive": ("landmarks", lambda p: (p / LAND).write_bytes(b"PK none"),
                       ["ann_0.npz", ".npz", "found"]),
    "strange channels": ("weights", lambda p: edit(p / CSV, "mouthSmileLeft", "Smile_L"),
                         ["ann_0.csv, row 1", "ARKit names", "smile_l"]),
    "a weight is a word": ("weights", lambda p: edit(p / CSV, "0.016667,", "0.016667,high"),
                           ["ann_0.csv, row 3", "a number", "high"]),
    "time goes back": ("weights", lambda p: edit(p / CSV, "0.033333,", "0.01,"),
                       ["ann_0.csv, row 4", "a time after 0.017 s", "0.010 s"]),
    "other vertices": ("vertices", lambda p: np.save(p / "vertices/ann_0.npy", np.zeros((9, 50, 3))),
                       ["ann_0.npy", "vertices of topology ball [T,", "[9, 50, 3]"]),
    "NaN in vertices": ("vertices", lambda p: spoil_frame(p / "vertices/ann_0.npy"),
                        ["ann_0.npy, row 70", "finite", "NaN"]),
    "no topology": ("vertices", lambda p: edit(p / "corpus.json", "topology", "topo"),
                    ["corpus.json", "the name of a folder in topologies", "None"]),
    "no neutral mesh": ("vertices", lambda p: (p / OBJ).unlink(), ["neutral.obj", "a file", "none"]),
    "a face beyond the vertices": ("vertices", lambda p: edit(p / OBJ, "\nf ", "\nf 9999 1 2\nf "),
                                   ["neutral.obj, row", "vertices 1 to", "9999"]),
    "67 landmarks of the mesh": ("vertices", table(list(range(67))),
                                 ["landmarks.json", "68 numbers", "(67,)"]),
    "a landmark beyond the mesh": ("vertices", table([*range(67), 5000]),
                                   ["landmarks.json, row 67", "vertices: 0 to", "5000"]),
    "phone of no length": ("landmarks", said("0.1\t0\tb\n"),
                           ["ann_0.tsv, row 2", "duration_s above 0", "'0'"]),
    "unknown phone": ("landmarks", said("0.1\t0.2\tb\n0.3\t0.1\t9\n"), ["ann_0.tsv, row 3", "IPA", "'9'"]),
    "sound alone": ("landmarks", deaf, ["landmarks, weights or vertices", "sound alone"]),
    "nothing to train on": ("landmarks", lambda p: (p / TSV).write_text(
        (p / TSV).read_text().replace("\ttrain\t", "\tval\t")), ["clips.tsv", "split train", "none"]),
}  # fmt: skip
TSV_HEAD = "clip\tspeaker\tsplit\temotion\tintensity\ttext\n"


def hole(frame: int) -> np.ndarray:
    """Zeros [300, 68, 3] with one NaN."""
    out = np.zeros((300, 68, 3))
    out[frame, 3, 0] = np.nan
    return out


@pytest.mark.parametrize("name", BAD)
def test_a_bad_corpus_says_what_is_wrong_where(copy, name):
    kind, spoil, words = BAD[name]
    path = copy(kind)
    spoil(path)
    errors = check(path).errors
    assert len(errors) >= 1
    assert all(word in errors[0] for word in words), errors[0]


def shift(p: Path, **how) -> None:
    for clip, seed in (("ann_0", 0), ("ann_1", 1)):
        soundfile.write(p / f"audio/{clip}.wav", spoken(SECONDS, seed, **how), 16000)


def scaled(p: Path, factor: float) -> None:
    array(p / LAND, lambda a: a | {k: factor * a[k] for k in ("landmarks", "neutral")})


def relabelled(p: Path) -> None:
    order = permutation()
    array(p / LAND, lambda a: a | {"landmarks": a["landmarks"][:, order], "neutral": a["neutral"][order]})


def turned(a: dict) -> dict:
    """The head of landmarks turns to and fro by ten degrees."""
    angle = 0.17 * np.sin(np.arange(len(a["landmarks"])) / 20.0)
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 0, 2], turn[:, 2, 0], turn[:, 1, 1] = np.sin(angle), -np.sin(angle), 1.0
    return a | {"landmarks": np.einsum("tij,tnj->tni", turn, a["landmarks"])}


ODD = {
    "late lips": ("landmarks", lambda p: shift(p, lag_s=0.3), "lips come 0.30 s before the sound"),
    "drift": ("landmarks", lambda p: shift(p, stretch=1.03), "drifts"),
    "metres are millimetres": ("landmarks", lambda p: scaled(p, 1000.0), "unit is mm"),
    "mirrored": ("landmarks", lambda p: array(p / LAND, lambda a: a | {
        k: a[k] * [-1, 1, 1] @ SPIN for k in ("landmarks", "neutral")}), "left and right are exchanged"),
    "sides of the landmarks": ("landmarks", relabelled, "left and right are exchanged"),
    "lost frames": ("landmarks", lambda p: array(p / LAND, lambda a: a | {"found": np.arange(300) > 60}),
                    "20% of the frames are lost"),
    "frames repeat": ("landmarks", lambda p: array(p / LAND, lambda a: a | {
        "landmarks": a["landmarks"][np.r_[:100, np.full(50, 99), 150:300]]}), "stands still for 2.0"),
    "frames left out": ("weights", lambda p: edit(p / CSV, "0.033333,0,0\n", "")
                        if "0.033333,0,0\n" in (p / CSV).read_text() else drop_line(p / CSV, 10),
                        "1 frames lost"),
    "percent": ("weights", lambda p: percent(p / CSV), "divide percent by 100"),
    "another length": ("landmarks", lambda p: array(p / LAND, lambda a: a | {
        "landmarks": a["landmarks"][:200]}), "lasts 8.00 s, the sound 12.00 s"),
    "silence": ("landmarks", lambda p: soundfile.write(p / "audio/ann_0.wav", np.zeros(192000), 16000),
                "sound is silent"),
    "clipping": ("landmarks", lambda p: soundfile.write(
        p / "audio/ann_0.wav", np.clip(90 * spoken(SECONDS, 0), -1, 1), 16000, "FLOAT"), "are clipped"),
    "a turning head": ("landmarks", lambda p: array(p / LAND, turned), "head turns by"),
    "nobody held out": ("landmarks", lambda p: [edit(p / TSV, "test", "train") for _ in range(2)],
                        "no clip is held out"),
    "a file of nobody": ("landmarks", lambda p: (p / "audio/eve.wav").write_bytes(b""),
                         "belongs to no row"),
    "an emotion of no strength": ("landmarks", lambda p: edit(p / TSV, "happy\t1", "happy\t0"), "as neutral"),
}  # fmt: skip


def drop_line(path: Path, number: int) -> None:
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:number] + lines[number + 1 :]) + "\n")


def percent(path: Path) -> None:
    head, *rows = path.read_text().splitlines()
    for number, row in enumerate(rows):
        second, *values = row.split(",")
        rows[number] = ",".join([second, *(str(100 * float(value)) for value in values)])
    path.write_text("\n".join([head, *rows]))


@pytest.mark.parametrize("name", ODD)
def test_an_odd_corpus_is_told(copy, name):
    kind, spoil, words = ODD[name]
    path = copy(kind)
    spoil(path)
    report = check(path)
    assert not report.errors
    assert any(words in odd for odd in report.odd), report.odd


@pytest.mark.parametrize("kind", ["landmarks", "weights", "vertices"])
def test_a_sound_corpus_has_nothing_odd(folders, kind):
    report = check(folders[kind])
    assert (report.errors, report.odd) == ([], [])
    assert report.kinds[kind] == 6 and abs(np.median(report.lags_s)) < 0.03
    assert ("stm.train" in report.sentences()[-1]) == (kind == "vertices")


def test_an_error_of_one_clip_does_not_hide_another(copy):
    path = copy("landmarks")
    (path / "audio/ann_0.wav").unlink()
    (path / "landmarks/cem_1.npz").write_bytes(b"")
    errors = check(path).errors
    assert len(errors) == 2 and "ann_0" in errors[0] and "cem_1" in errors[1]


def test_clips_carry_motion_emotion_and_split(folders):
    read = clips(CorpusFolder(folders["landmarks"]))
    assert [c.name for c in read] == ["ann_0", "ann_1", "ben_0", "ben_1", "cem_0", "cem_1"]
    assert (read[0].emotion, read[0].intensity, read[5].held_out) == ("happy", 1.0, True)
    truth = talking(SECONDS, 0) - canonical_landmarks()
    np.testing.assert_allclose(read[0].motion, truth[: len(read[0].motion)], atol=2e-5)


def test_weights_at_any_rate_move_arkit_modes(folders):
    clip = clips(CorpusFolder(folders["weights"]))[2]
    open_ = opening(np.arange(int(SECONDS * 16000)) / 16000, 10)[::640][: len(clip.motion)]
    modes = arkit_modes()
    expected = open_[:, None, None] * (modes["jawOpen"] + 0.1 * modes["mouthSmileLeft"])
    assert np.abs(clip.motion - expected).max() < 1e-3


def test_a_moving_head_and_another_unit_give_the_same_motion(folders, copy):
    path = copy("landmarks")
    edit(path / "corpus.json", '"m"', '"mm"')
    edit(path / "corpus.json", "still", "moves")
    for file in (path / "landmarks").glob("*.npz"):
        array(file, lambda a: turned(a) | {"neutral": a["neutral"]})
        array(file, lambda a: a | {k: 1000.0 * a[k] @ SPIN for k in ("landmarks", "neutral")})
    assert not any("exchanged" in odd or "wide" in odd for odd in check(path).odd)
    truth, motion = (clips(CorpusFolder(p))[0].motion for p in (folders["landmarks"], path))
    assert np.abs(motion - truth).max() < 1.5e-3 < 0.1 * np.abs(truth).max()


def test_a_neutral_face_is_found_in_the_quiet(folders, copy):
    path = copy("landmarks")
    for file in (path / "landmarks").glob("*.npz"):
        array(file, lambda a: {"landmarks": a["landmarks"], "fps": a["fps"]})
    clip = clips(CorpusFolder(path))[2]
    shut, rest = (inner_gap(x[None], np.zeros((68, 3)))[0] for x in (clip.neutral, canonical_landmarks()))
    assert abs(shut - rest) < 5e-4


def test_barycentric_landmarks_and_meshes_of_frames(folders, copy):
    path = copy("vertices")
    vertices = np.load(path / "vertices/ann_0.npy")
    folder = CorpusFolder(path)
    corners = folder.topology(folder.rows[0]).triangles[:68]
    marks = {"triangles": list(range(68)), "barycentric": [[0.2, 0.3, 0.5]] * 68}
    (path / MARKS).write_text(json.dumps(marks))
    other = Path(shutil.copytree(path, path.with_name("other")))
    topology = CorpusFolder(other).topology(folder.rows[0])
    expected = np.einsum("k,tnkx->tnx", [0.2, 0.3, 0.5], vertices[:, corners])
    np.testing.assert_allclose(topology.landmarks(vertices), expected, atol=1e-7)


def test_errors_carry_their_parts(tmp_path):
    with pytest.raises(CorpusError) as caught:
        CorpusFolder(tmp_path)
    assert (caught.value.row, caught.value.expected, caught.value.actual) == (None, "a file", "none")


def test_landmarks_that_a_source_does_not_see_carry_no_weight(copy):
    path = copy("landmarks")
    eyes = np.arange(68) // 12 != 3
    array(path / LAND, lambda a: a | {"seen": eyes})
    clip = clips(CorpusFolder(path))[0]
    assert (clip.weight[:, eyes] == 1.0).all() and (clip.weight[:, ~eyes] == 0.0).all()
    array(path / LAND, lambda a: a | {"seen": eyes[:60]})
    with pytest.raises(CorpusError, match=r"expected seen \[68\], found \[60\]"):
        clips(CorpusFolder(path))
