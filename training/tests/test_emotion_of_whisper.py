"""The ear for the emotion of a recording: what it learns, and that the recording's source says nothing."""

from pathlib import Path

import numpy as np
import soundfile
import torch

from training.corpus import crema_d
from training.speech.emotion_rows import Rows, loudest_part
from training.speech.fit_emotion import (
    ALLOWED,
    DOUBT,
    beside_neutral,
    calibrated,
    expecting,
    fitted,
    groups,
    odds_of,
    right,
    shown_of_corpus,
)
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS

SIZE = 40


def rows_of_strangers(random: np.random.Generator) -> Rows:
    """Actors who feel along axes 0 to 5, each with a voice of his own; their corpus shows along axis 20, and
    readers of two corpora along 21 and 22."""
    columns = []
    for actor in range(20):
        own = random.standard_normal(SIZE) * (np.arange(SIZE) >= 10)
        for clip in range(30):
            label = clip % 6
            x = own + 0.3 * random.standard_normal(SIZE)
            x[label] += 3.0 * (label > 0)
            x[20] += 5.0
            columns.append((x, crema_d.SOURCE, f"{crema_d.SOURCE} {actor}", label))
    for axis, source in ((21, "kathleen_en"), (22, "kerstin_de")):
        for _ in range(60):
            x = 0.3 * random.standard_normal(SIZE)
            x[axis] += 5.0
            columns.append((x, source, f"{source} reader", 0))
    x, source, speaker, label = (np.array(column) for column in zip(*columns, strict=True))
    votes = torch.nn.functional.one_hot(torch.from_numpy(label), len(HEARD_EMOTIONS)).float()
    nothing = np.zeros(len(x), int)
    return Rows(torch.from_numpy(x).float(), source, speaker, label, votes, nothing, nothing.astype(bool))


def test_an_emotion_is_known_in_another_kind_of_recording():
    random = np.random.default_rng(0)
    rows = rows_of_strangers(random)
    layer = fitted(rows, np.ones(len(rows), bool))
    stranger = 0.3 * random.standard_normal((60, SIZE))
    label = np.arange(60) % 6
    stranger[np.arange(60), label] += 3.0 * (label > 0)
    # A reader's room, in which nobody was ever angry.
    stranger[:, 21] += 5.0
    assert (layer.logits(stranger)[:, :6].argmax(axis=1) == label).mean() > 0.9
    everybody = np.ones(len(rows), bool)
    assert right(layer, rows, everybody, list(range(6)), by_vote=False) > 0.9
    assert right(layer, rows, everybody, list(range(6)), by_vote=True) > 0.9


def test_the_bias_of_neutral_lets_few_readings_show():
    rows = rows_of_strangers(np.random.default_rng(0))
    layer = fitted(rows, np.ones(len(rows), bool))
    readings = rows.x[torch.from_numpy(rows.source != crema_d.SOURCE)]
    doubts = odds_of(layer, readings)
    moved = calibrated(layer, doubts)
    shown = 1.0 / (1.0 + np.exp(-odds_of(moved, readings))) > DOUBT
    assert shown.mean() <= ALLOWED + 1.0 / len(readings) and np.array_equal(moved.weight, layer.weight)
    assert groups(rows) == [{"kathleen_en"}, {"kerstin_de"}]
    lines = list(shown_of_corpus(rows, rows.source == crema_d.SOURCE, layer, doubts))
    assert len(lines) == 2 and all("of them as acted 1.00" in line for line in lines)


def test_a_speakers_neutral_voice_becomes_that_of_readers():
    rows = rows_of_strangers(np.random.default_rng(0))
    layer = fitted(rows, np.ones(len(rows), bool))
    actors = rows.source == crema_d.SOURCE
    moved = beside_neutral(rows, actors, layer)
    neutral = moved.x[torch.from_numpy(actors & (rows.label == 0))].mean(0)
    assert torch.allclose(neutral, torch.from_numpy(layer.readers).float(), atol=1e-4)
    assert torch.equal(moved.x[torch.from_numpy(~actors)], rows.x[torch.from_numpy(~actors)])


def test_an_ear_expects_what_its_listeners_named():
    rows = rows_of_strangers(np.random.default_rng(0))
    is_acted = rows.source == crema_d.SOURCE
    rows.votes[torch.from_numpy(is_acted)] = torch.tensor([0.5, 0.1, 0.1, 0.1, 0.1, 0.1, 0.0])
    layer = fitted(rows, np.ones(len(rows), bool))
    for by_vote, share in ((True, 0.5), (False, 1.0 / 6.0)):
        moved = expecting(layer, rows, is_acted, by_vote)
        logits = moved.logits(rows.x[torch.from_numpy(is_acted)].double().numpy())[:, :6]
        neutral = torch.from_numpy(logits).softmax(1)[:, 0].mean()
        assert abs(float(neutral) - share) < 0.01 and moved.bias[6] == layer.bias[6]


def test_the_loudest_two_seconds_are_taken():
    sound = np.zeros(80000, np.float32)
    sound[50000:60000] = 0.5
    part = loudest_part(sound)
    assert len(part) == 32000 and (part > 0).sum() == 10000
    assert len(loudest_part(sound[:20000])) == 20000


def test_votes_are_read_as_shares(tmp_path: Path):
    folder = tmp_path / "speech" / crema_d.SOURCE
    (folder / "1001").mkdir(parents=True)
    soundfile.write(folder / "1001/DFA_ANG_XX.ogg", np.zeros(1600), 16000)
    head = ["clip", "actor", "sex", "age", "sentence", "acted", "level"]
    head += [f"heard_{name}" for name in ("anger", "disgust", "fear", "happy", "neutral", "sad")]
    line = ["1001/DFA_ANG_XX", "1001", "male", "51", "DFA", "ANG", "XX", "6", "2", "0", "0", "2", "0"]
    (folder / "clips.tsv").write_text("\t".join(head) + "\n" + "\t".join(line) + "\n")
    (clip,) = crema_d.read_voted(tmp_path)
    assert (clip.emotion, clip.votes["angry"], clip.votes["neutral"]) == ("angry", 0.6, 0.2)
    assert clip.votes["disgusted"] == 0.2 and len(clip.samples) == 1600 and not clip.held_out
