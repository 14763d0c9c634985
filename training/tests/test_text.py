"""Sentences taken apart, pairs that keep their word, and a tower that learns."""

import argparse

import numpy as np
import pytest
import torch

from training.corpus.conditions import UNITS
from training.nn.checkpoint import write_model
from training.text.clip import OnClip
from training.text.golden_clip import write_folder
from training.text.held_out import HELD_OUT, TABLE_13
from training.text.measure import Counts, measured
from training.text.measure import main as measure_folder
from training.text.pairs import EMOTIONS, EXPRESSIONS, NOTHING, OPPOSITES, TEMPLATES
from training.text.sentences import Clause, Shown, clauses, listed
from training.text.space import known_form
from training.text.stored import arrays, config_of, load_model_folder
from training.text.tower import Heard, OnWords, TextTower
from training.text.train import Pairs, targets, train
from training.text.words import Words

PARTS_OF_A_FACE = {"eyes", "mouth", "eyebrows", "brows", "nose"}


def words_of(texts) -> set[str]:
    return {w for text in texts for c in clauses(text) for w in c.words + c.denied}


def made_up_space() -> Words:
    """Places at random for the words of the pairs."""
    names = sorted(words_of(text for text, _ in listed(EMOTIONS) + listed(EXPRESSIONS)))
    places = np.random.default_rng(0).standard_normal((len(names), 24)).astype(np.float32)
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    extra = {f"far{i}": len(names) + i for i in range(20)}
    far = np.eye(20, 24, dtype=np.float32)
    rows = {name: row for row, name in enumerate(names)} | extra
    return Words(rows, np.concatenate([places, far * 0.01]), np.zeros((64, 24), np.float32))


@pytest.mark.parametrize(
    "text, expected",
    [
        ("She isn't happy", [Clause([], ["happy"])]),
        ("raises the left eyebrow", [Clause(["raises", "eyebrow"], [], "left")]),
        ("a huge smile, not sad", [Clause(["smile"], [], None, 1.5), Clause([], ["sad"])]),
        ("don\u2019t wink but smile", [Clause([], ["wink"]), Clause(["smile"])]),
        ("a smile without raised eyebrows, no frown", [Clause(["smile"]), Clause([], ["frown"])]),
        ("closes one eye", [Clause(["closes", "eye"], [], "one_sided")]),
        ("", [Clause()]),
    ],
)
def test_clauses(text, expected):
    assert clauses(text) == expected


def test_templates_say_nothing():
    for template in TEMPLATES:
        assert clauses(template.format("smile")) == [Clause(["smile"])], template


def test_no_word_of_expression_is_both_learned_and_held_out():
    shown = words_of(text for text, _ in listed(EMOTIONS) + listed(EXPRESSIONS))
    learned = shown | words_of(NOTHING.split(","))
    held_out = words_of(text for text, _ in listed(HELD_OUT)) - PARTS_OF_A_FACE
    stems = {known_form(word, learned) for word in held_out}
    assert stems == {None}


def test_units_of_all_tables_are_known():
    for table in (EMOTIONS, EXPRESSIONS, HELD_OUT, {units: text for text, units in TABLE_13.items()}):
        for _, shown in listed(table):
            assert all(0 < strength <= 1 for strength in shown.units.values())
    assert all(units in EMOTIONS for units in OPPOSITES)


def test_what_is_shown_together():
    both = Shown.read("12L 45:0.3") | Shown.read("12 1L")
    assert both.units == {UNITS.index("12"): 1.0, UNITS.index("45"): 0.3, UNITS.index("1"): 1.0}
    assert both.one_sided == {UNITS.index("1")}


def test_targets_hold_side_and_strength():
    target = targets([Shown.read("12L 45:0.3")])[0]
    assert target[0].sum() == 2 and target[1].sum() == 1
    assert target[2, UNITS.index("45")] == pytest.approx(0.2)


def test_counts():
    counts = Counts()
    counts.add({1, 2}, {2, 3})
    assert (counts.right, counts.wrong, counts.missed, counts.f1) == (1, 1, 1, 0.5)


def test_words_that_are_no_words_leave_no_features():
    tower = TextTower(24, 8)
    heard = Heard.of([Clause(["zzz"]), Clause()], made_up_space())
    assert torch.equal(tower.mean(heard.words), torch.zeros(2, 24))


def test_the_shipped_model_recognises_the_sentences_of_table_13():
    result = measure_folder()
    assert result["table_13"] == "6 of 6" and result["f1"] > 0.75
    assert "synonym" not in result


def test_a_model_folder_gives_back_its_words_and_tower(tmp_path):
    words, tower = made_up_space(), TextTower(24, 8)
    folder = write_model(tmp_path / "text_units", arrays(tower, words), config_of(tower, words), exact=("",))
    read_words, read_tower = load_model_folder(folder)
    assert read_words.rows == words.rows and np.array_equal(read_words.of("smile"), words.of("smile"))
    heard = Heard.of([Clause(["smile"], ["frown"])], words)
    assert torch.equal(read_tower(heard), tower(heard))
    config = config_of(tower, words, tmp_path / "clip")
    with pytest.raises(ValueError, match="expected a model on the text space, got one on CLIP"):
        load_model_folder(write_model(folder, arrays(tower, words), config))


@pytest.mark.slow
def test_a_tower_learns_the_texts_of_its_pairs():
    options = {"seed": 0, "hidden": 64, "rate": 1e-2, "decay": 1e-2, "noise": 0.02, "steps": 250, "batch": 64}
    options = argparse.Namespace(**options, info_nce=0.1)
    words, pairs = made_up_space(), Pairs.all()
    pairs = Pairs(pairs.shown[::12], pairs.denied[::12], pairs.nothing)
    hearing = OnWords(words)
    tower, again = (train(pairs, words, hearing, options) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(tower.parameters(), again.parameters(), strict=True))
    assert measured(tower, hearing, words, pairs.shown, pairs.shown)["f1"] > 0.6


@pytest.mark.slow
def test_a_tower_on_clip_learns_and_is_exported_with_its_folder(tmp_path):
    write_folder(tmp_path / "clip", width=64)
    options = {"seed": 0, "hidden": 64, "rate": 3e-2, "decay": 1e-2, "noise": 0.005, "info_nce": 0.1}
    options = argparse.Namespace(**options, steps=1200, batch=64)
    words, pairs, hearing = made_up_space(), Pairs.all(), OnClip(tmp_path / "clip")
    pairs = Pairs(pairs.shown[::24], pairs.denied[::24], pairs.nothing)
    tower = train(pairs, words, hearing, options)
    assert measured(tower, hearing, words, pairs.shown, pairs.shown)["f1"] > 0.6
    assert config_of(tower, words, tmp_path / "clip")["clip"] == str(tmp_path / "clip")
    assert arrays(tower, words)["down.weight"].shape == (64, 64)
