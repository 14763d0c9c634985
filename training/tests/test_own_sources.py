"""The project's own sources as corpus folders give the clips that their own readers give."""

import numpy as np

from training.corpus import grid, ict_sequences
from training.corpus.aligned import read_grid_speech
from training.corpus.clip import inner_gap
from training.corpus.facegood import read_facegood
from training.corpus.folder import CorpusFolder
from training.corpus.folder_clips import clips
from training.corpus.readers import project
from training.corpus.sequence_meshes import sequence_meshes
from training.flags import run_command
from training.tests.test_parity import SHARED, needs_shared

FRAMES_APART = 1


def alike(actual, expected, atol_m: float) -> None:
    """Asserts the same motion, side and sound of clips of the same names."""
    assert [c.name for c in actual] == [c.name.replace("/", "_") for c in expected]
    for a, b in zip(actual, expected, strict=True):
        frames = min(len(a.motion), len(b.motion))
        assert abs(len(a.motion) - len(b.motion)) <= FRAMES_APART and a.held_out == b.held_out
        np.testing.assert_allclose(a.motion[:frames], b.motion[:frames], atol=atol_m)
        heard = slice(640 * (frames - 1))
        np.testing.assert_allclose(a.samples[heard], b.samples[heard], atol=1e-4)


@needs_shared
def test_facegood_as_a_folder_is_what_its_reader_gives(tmp_path):
    folder = project.facegood_zh(SHARED / "data", tmp_path / "facegood_zh", None)
    expected = sorted(read_facegood(SHARED / "data"), key=lambda c: c.name.replace("/", "_"))
    alike(clips(CorpusFolder(folder)), expected, 1e-4)


@needs_shared
def test_grid_as_a_folder_is_what_its_reader_gives(tmp_path, monkeypatch):
    few = grid.read_grid(SHARED / "data")[:11:5]
    names = {clip.name for clip in few}
    monkeypatch.setattr(project.grid, "read_grid", lambda data: few)
    monkeypatch.setattr(project, "read_grid_speech", lambda data: read_grid_speech(data, chosen=names))
    converted = clips(CorpusFolder(project.grid_s1(SHARED / "data", tmp_path / "grid_s1", None)))
    alike(converted, few, 1e-6)
    for a, b in zip(converted, few, strict=True):
        assert np.array_equal(a.weight, b.weight) and len(a.phones) > 8


@needs_shared
def test_each_of_five_speakers_moves_about_his_own_rest():
    speakers: dict[str, list] = {}
    for clip in grid.read_grid_five(SHARED / "data"):
        assert not clip.held_out and abs(len(clip.samples) / 16000 - len(clip.motion) / 25) < 0.1
        speakers.setdefault(clip.name.split("_")[0], []).append(clip)
    counts = {"s4": 49, "s26": 10, "s31": 10, "s30": 2, "s33": 2}
    assert {name: len(own) for name, own in speakers.items()} == counts
    for own in speakers.values():
        gaps = np.concatenate([inner_gap(c.motion, c.neutral) for c in own])
        rest = inner_gap(0 * own[0].motion[:1], own[0].neutral)[0]
        # The mouth of s26 stands open even where he is silent.
        assert rest < 3e-3 and rest < np.quantile(gaps, 0.3)
        assert 5e-3 < np.quantile(gaps, 0.95) < 25e-3


@needs_shared
def test_faces_of_ict_speak_and_hold_out_people_and_take(tmp_path):
    flags = ["--triangles", "1500", "--people", "2", "--held-out", "1", "--stretches", "1"]
    run_command(ict_sequences.main, ["--data", str(SHARED / "data"), "--out", str(tmp_path), *flags])
    train, test = (sequence_meshes([tmp_path / "ict_0"], held_out) for held_out in (False, True))
    assert [mesh.name for mesh in train] == ["ict_0_train00", "ict_0_train01"] and len(test) == 1
    assert not np.allclose(train[0].neutral, train[1].neutral, atol=1e-4)
    moved = test[0].displacements(0, np.arange(150)).norm(dim=-1)
    assert 0.02 < float(moved.max()) < 0.5, "decimetres"
