"""Facts about the co-articulation teacher and its parameters; those with a face need ../shared."""

import json

import numpy as np
import pytest
import torch

from training.corpus.articulation import COMPONENTS
from training.corpus.phones import SEGMENTS, Phone
from training.corpus.teacher import LEAST_GAP_M, PARAMETERS, Teacher, closure, row_of


def speech(count: int, seed: int) -> list[Phone]:
    """Random phones without pauses between them."""
    random, at, phones = np.random.default_rng(seed), 0.2, []
    for label in random.choice([*SEGMENTS[1:], *"pbm" * 4], count):
        phones.append(Phone(at, float(random.uniform(0.04, 0.2)), str(label)))
        at = phones[-1].end_s
    return phones


def gap(motion: np.ndarray) -> np.ndarray:
    """Inner-lip gap over neutral, [T] millimetres."""
    return (motion[:, 62, 1] - motion[:, 66, 1]) * 1e3


@pytest.fixture(scope="module")
def teacher() -> Teacher:
    """The fitted teacher."""
    return Teacher.load()


def test_pauses_fill_what_nobody_speaks():
    row = row_of([Phone(0.5, 0.1, "a"), Phone(0.6, 0.2, "s")], 2.0)
    assert [SEGMENTS[i] for i in row.index] == ["_", "a", "s", "_"]
    np.testing.assert_allclose(row.core_s[1:3], [0.55, 0.7])
    assert list(row_of([], 1.0).index) == [0]


def test_a_closure_holds_from_before_the_phone_to_its_end():
    seconds = np.arange(0, 1, 0.01)
    shut = closure([Phone(0.2, 0.2, "a"), Phone(0.4, 0.1, "b"), Phone(0.5, 0.2, "a")], seconds)
    assert (shut[(seconds > 0.32) & (seconds < 0.48)] == 1).all()
    assert (shut[(seconds < 0.24) | (seconds > 0.56)] == 0).all()


def test_parameters_are_small_and_cover_every_segment():
    saved = json.loads(PARAMETERS.read_text())
    assert PARAMETERS.stat().st_size < 60_000
    targets = np.array(saved["targets"])
    assert targets.shape == (len(SEGMENTS), len(COMPONENTS))
    assert (targets[0] == 0).all() and np.abs(targets).max() < 6
    assert np.array(saved["rates"]).min() > 0 and np.array(saved["strengths"]).min() > 0


def test_lips_meet_at_p_b_m_and_never_cross(teacher):
    for seed in range(8):
        random = np.random.default_rng(seed) if seed % 2 else None
        phones = speech(60, seed)
        motion = teacher.motion(phones, 250, random=random)
        shut = closure(phones, np.arange(250) / 25.0)
        assert (shut == 1).sum() > 3
        assert gap(motion)[shut == 1].max() < 0.01
        for upper, lower in ((61, 67), (62, 66), (63, 65)):
            assert (motion[:, upper, 1] - motion[:, lower, 1]).min() > LEAST_GAP_M - 1e-6


def test_a_closure_takes_a_frame_or_two(teacher):
    phones = [Phone(0.2, 0.4, "a"), Phone(0.6, 0.1, "p"), Phone(0.7, 0.4, "a")]
    opened = gap(teacher.motion(phones, 35))
    assert opened[10] > 2.0 and opened[20] > 2.0
    assert opened[14:17].min() < 0.0


def test_silence_is_the_neutral_face(teacher):
    motion = teacher.motion([Phone(1.0, 0.3, "a")], 75)
    assert np.abs(motion[:12]).max() < 3e-4 and np.abs(motion[60:]).max() < 3e-4
    assert gap(motion).max() > 3.0


def test_open_vowels_open_more_and_u_is_narrower_than_i(teacher):
    def measure(vowel):
        motion = teacher.motion([Phone(0.4, 0.6, vowel)], 40)[18]
        return gap(motion[None])[0], (motion[54, 0] - motion[48, 0]) * 1e3

    assert measure("ɑ")[0] > measure("i")[0] + 2.0 and measure("ɛ")[0] > measure("i")[0]
    assert measure("i")[1] - measure("u")[1] > 5.0


def test_long_speech_gives_what_its_parts_give(teacher):
    phones = speech(90, 3)
    slow = teacher.motion(phones, 840, 50.0)[::2]
    np.testing.assert_allclose(teacher.motion(phones, 420), slow, atol=1e-5)


def test_random_utterances_differ_and_repeat_with_their_seed(teacher):
    phones = speech(30, 4)
    a, b, c = (teacher.motion(phones, 100, random=np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(a, b) and np.abs(a - c).max() > 5e-4


def test_fitted_model_with_gradients_is_the_teacher():
    from training.corpus.fit_teacher import Dominance, measures, padded

    guess = Teacher.load(clear=False)
    model = Dominance(guess.basis, np.ones(len(SEGMENTS), bool))
    torch.manual_seed(0)
    torch.nn.init.normal_(model.kin[:, :4])
    torch.nn.init.constant_(model.kin[-1:, COMPONENTS.index("chin")], 3.0)
    guess.targets = model.targets().detach().numpy()
    strengths, rates, lead = (x.detach().numpy() for x in model.shapes())
    guess.strengths, guess.rates, guess.lead_s = strengths, rates, float(lead)
    phones = [p for p in speech(40, 5) if p.label not in "pbmʙɸβ"]

    class Silent:
        motion = np.zeros((80, 68, 3), np.float32)

    predicted = model(*padded([(Silent(), phones)]), 80)[0].detach().numpy()
    open_lips = predicted[:, 0] > 0.0
    taught = measures(guess.motion(phones, 80))
    np.testing.assert_allclose(predicted[open_lips], taught[open_lips], atol=0.05)
    assert open_lips.sum() > 20
    assert torch.isfinite(model.prior())
