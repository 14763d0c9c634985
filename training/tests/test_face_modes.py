"""The exported emotion prototypes are those that training adds to neutral motion."""

import json
from pathlib import Path

import pytest

from training.corpus.clip import FPS
from training.corpus.manner import OFFSET_OVER_ONSET, SETTLING_FRAMES
from training.export_face_modes import prototype
from training.systems.freetalk.ats import EMOTIONS

CONFIG = Path(__file__).resolve().parents[2] / "rust-core/models/face_modes/config.json"


def test_the_exported_emotions_are_up_to_date():
    config = json.loads(CONFIG.read_text())
    assert list(config["emotions"]) == EMOTIONS
    assert config["settling_s"] == pytest.approx(SETTLING_FRAMES / FPS)
    assert config["fall_over_rise"] == pytest.approx(OFFSET_OVER_ONSET)
    for emotion, parts in config["emotions"].items():
        wanted = prototype(emotion, config["modes"])
        assert parts == wanted, f"{emotion}: run training.export_face_modes again"


def test_a_shape_of_both_sides_is_written_as_two():
    weights = prototype("sad", json.loads(CONFIG.read_text())["modes"])["lasting"]
    assert weights["browInnerUp_L"] == weights["browInnerUp_R"] > 0
    assert "browInnerUp" not in weights
