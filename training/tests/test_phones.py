"""Phones and letters: classes, units of words, and the best path against all paths."""

import itertools

import numpy as np
import pytest
import torch

from training.corpus.heard import _ipa
from training.corpus.phones import SEGMENTS, segments
from training.speech.letters import (
    LEAST_ROWS,
    LONGEST_SKIP,
    RULES,
    UNITS,
    best_path,
    states_of,
    table_of_rules,
    units,
    word_times,
)
from training.speech.phones import CLASSES, COARSE, PARTS, PhoneConfig, PhoneReadout, class_of_segment


def signs(word):
    return [UNITS[index] for index in units(word)]


def test_every_segment_has_a_class_and_every_class_a_coarser_one():
    classes = class_of_segment()
    assert len(classes) == len(SEGMENTS) and set(classes.tolist()) == set(range(len(CLASSES)))
    coarse = "".join(COARSE)
    assert sum(sign in coarse for sign in CLASSES) >= len(CLASSES) - 2


def test_words_become_letters_and_groups():
    assert signs("Schuß") == ["sch", "u", "s"]
    assert signs("thought") == ["th", "ou", "gh", "t"]
    assert signs("Жя7") == ["*", "*", "*"] and signs("—") == []


def test_rules_are_probabilities_of_classes_that_there_are():
    table = table_of_rules()
    assert np.allclose(table.sum(axis=1), 1.0)
    assert set("".join(RULES.values())) <= set(CLASSES) and set(RULES) == set(UNITS) - {"*"}


def score(emission, skip, path):
    """Nepers of a path; −inf for one that cannot be."""
    ends = [-1, *path, len(skip)]
    total = emission[np.arange(len(path)), list(path)].sum()
    for a, b in itertools.pairwise(ends):
        if b < a or b - a > LONGEST_SKIP + 1:
            return -np.inf
        total -= skip[a + 1 : b].sum()
    return total


@pytest.mark.parametrize("seed", range(6))
def test_the_best_path_is_the_best_of_all(seed):
    random = np.random.default_rng(seed)
    emission, skip = random.normal(size=(5, 6)), random.uniform(0.0, 1.5, 6)
    every = itertools.product(range(6), repeat=5)
    best = max(score(emission, skip, path) for path in every)
    assert np.isclose(score(emission, skip, best_path(emission, skip)), best)


def test_words_are_found_where_they_are_said():
    states = states_of(["see", "b"])
    # Each state once, pauses five times.
    path = np.repeat(np.arange(len(states.unit)), np.where(states.word < 0, 5, 1))
    emission = np.where(np.arange(len(states.unit))[None] == path[:, None], 0.0, -20.0)
    spans = word_times(best_path(emission, states.skip), states, 100.0, 0.0)
    rows = {word: np.flatnonzero(states.word[path] == word) for word in (0, 1)}
    assert {word: times[0] for word, times in spans.items()} == {
        word: pytest.approx((frames[0] - 0.5) / 100.0) for word, frames in rows.items()
    }
    assert len(rows[0]) == LEAST_ROWS * 2 and len(rows[1]) == LEAST_ROWS * 3


def test_posteriors_have_four_rows_to_a_frame():
    model = PhoneReadout(PhoneConfig(channels=8, hidden=4))
    log_p = model(torch.randn(2, 5, 8))
    assert log_p.shape == (2, 5 * PARTS, len(CLASSES))
    assert torch.allclose(log_p.exp().sum(dim=-1), torch.ones(2, 20))


def test_labels_of_the_emotional_database_are_phones():
    labels = ("aI", "!t", "kasp", "6", "-sth", ".")
    assert [_ipa(label) for label in labels] == ["aɪ", "t", "k", "ɐ", None, "_"]
    assert segments(_ipa("OY")) == ["ɔ", "ʏ"]
