"""The exported expressions are those of the tables; strengths and closures are checked in Rust."""

import json

import numpy as np

from training import shipped
from training.corpus.conditions import EMOTIONS
from training.corpus.emotions import PROTOTYPES, YIELDING, expressions
from training.corpus.manner import MANNERS, manners_config
from training.nn.checkpoint import read_arrays
from training.tests.test_parity import SHARED, needs_shared

FOLDER = shipped("expressions")


def test_every_emotion_has_a_prototype_and_a_manner():
    assert set(PROTOTYPES) == set(MANNERS) == set(EMOTIONS)


def test_the_exported_manners_are_up_to_date():
    exported = json.loads((FOLDER / "config.json").read_text())
    assert exported == manners_config(), "run training.export expressions again"


@needs_shared
def test_the_exported_expressions_are_up_to_date():
    exported = {name: value.numpy() for name, value in read_arrays(FOLDER).items()}
    for name, part in zip(("lasting", "opening"), expressions(SHARED / "data"), strict=True):
        np.testing.assert_allclose(exported[name], part, atol=1e-7, err_msg=name)


@needs_shared
def test_only_the_mouth_and_jaw_yield():
    _, opening = expressions(SHARED / "data")
    still = np.setdiff1d(np.arange(68), YIELDING)
    assert (opening[:, still] == 0).all() and (opening[EMOTIONS.index("disgusted")] != 0).any()
