"""Labels of felt speech become phones, and one recording's clock another's."""

import numpy as np
import pytest

from training.corpus.feelings import Felt, clock, pairs, phones_of
from training.corpus.phones import Phone, segments


def label(start: float, duration: float, text: str) -> dict:
    return {"start": start, "duration": duration, "label": text}


def test_closure_burst_and_breath_of_a_plosive_are_one_phone():
    found = phones_of([label(0.1, 0.04, "_t"), label(0.14, 0.02, "!t"), label(0.16, 0.05, "tasp"),
                       label(0.21, 0.1, "E6")])  # fmt: skip
    assert [(p.label, round(p.start_s, 3), round(p.end_s, 3)) for p in found] == [
        ("t", 0.1, 0.21),
        ("ɛɐ", 0.21, 0.31),
    ]
    assert segments("ɛɐ") == ["ɛ", "ɐ"]


def test_what_modifies_a_phone_lengthens_it():
    found = phones_of([label(0.0, 0.1, "a"), label(0.1, 0.05, "-lar"), label(0.15, 0.1, "m")])
    assert [(p.label, round(p.duration_s, 3)) for p in found] == [("a", 0.15), ("m", 0.1)]


def test_the_clock_meets_the_same_phones():
    one = [Phone(0.1, 0.1, "m"), Phone(0.2, 0.2, "a"), Phone(0.4, 0.1, "t")]
    other = [Phone(0.2, 0.2, "m"), Phone(0.4, 0.1, "x"), Phone(0.5, 0.3, "a"), Phone(0.8, 0.3, "t")]
    at = clock(one, other, np.array([0.1, 0.15, 0.2, 0.3, 0.45, 0.6]))
    assert at == pytest.approx([0.2, 0.3, 0.4, 0.6, 0.95, 1.2], abs=1e-6)
    assert (np.diff(clock(one, other, np.linspace(0, 2, 50))) > 0).all()


def test_pairs_are_of_one_actor_and_sentence_in_two_feelings():
    def felt(name: str, actor: str, sentence: str, feeling: str) -> Felt:
        return Felt(name, actor, sentence, feeling, 1.0, False, np.zeros(1), [])

    clips = [felt("a", "03", "x", "sad"), felt("b", "03", "x", "angry"), felt("c", "03", "x", "sad"),
             felt("d", "03", "y", "angry"), felt("e", "08", "x", "angry")]  # fmt: skip
    assert {(a.name, b.name) for a, b in pairs(clips)} == {("a", "b"), ("b", "c")}
