"""A denoiser that is conditioned as printed (eq. 5): the upper face follows emotion and intensity."""

import pytest
import torch

from training.corpus.bank import Entry
from training.nn.checkpoint import restored
from training.systems.freetalk import train
from training.systems.freetalk.ats import ANY_STYLE, AtsConfig, AtsDenoiser
from training.tests.made_up import FELT, felt_grades


@pytest.mark.slow
def test_the_upper_face_follows_label_and_intensity(tmp_path):
    folder = felt_grades(tmp_path / "grades")
    flags = ["--corpus", str(folder), "--out", str(tmp_path / "run"), "--recipe", "paper", "--steps", "120",
             "--rate", "1e-3", "--tokens", "256", "--log-every", "1000"]  # fmt: skip
    arguments = train.parser().parse_args(flags)
    saved = torch.load(train.train(arguments))
    config = AtsConfig.from_json(saved["config"])
    assert config.emotion == "learned"
    model = restored(AtsDenoiser(config), saved["state"])
    speech = train.speech_source(arguments, config)
    entries = [entry for entry in speech.entries if entry.held_out]
    style = config.styles.index(ANY_STYLE)

    def brows(entry: Entry) -> float:
        """Mean height of the inner brows, mm."""
        motion = train.clip_motion(speech, model, entry, style, config.sampling)
        return 1000.0 * motion[:, [3 * 21 + 1, 3 * 22 + 1]].mean().item()

    heights = {(entry.emotion, entry.intensity): brows(entry) for entry in entries}
    assert heights["happy", 1.0] > heights["happy", 0.5] > 0.0 > heights["angry", 0.5] > heights["angry", 1.0]
    for emotion in FELT:
        assert 0.25 < heights[emotion, 0.5] / heights[emotion, 1.0] < 0.75
