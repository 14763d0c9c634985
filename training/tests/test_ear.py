"""Facts about the teacher on Whisper and the lessons that it gives, on made-up features."""

import numpy as np
import pytest
import torch

from training.corpus.ear import LAYERS, EarClip
from training.corpus.phones import SEGMENTS, Phone
from training.corpus.windows import AugmentOptions
from training.losses import SCALE_M, lip_gap
from training.nn.checkpoint import save
from training.speech import strangers
from training.speech.compact import CompactEncoder, debug_config
from training.speech.ear import MOTION, EarConfig, EarTeacher, EarToMotion, TargetWindows, timed, with_target
from training.speech.fold import feature_map, folded
from training.speech.train_ear import EarSampler, phones_right

WIDTH = 8


def clip(name: str, source: str, frames: int, seed: int, voices: int = 2) -> EarClip:
    """Features and a mouth that opens with the first of them; p in its middle, silence around it."""
    random = torch.Generator().manual_seed(seed)
    heard = torch.randn(voices, len(LAYERS), 2 * frames, WIDTH, generator=random)
    motion = torch.zeros(frames, MOTION)
    motion[:, 3 * 66 + 1] = -5e-3 - 2e-3 * heard[0, 0, ::2, 0]
    motion[:, 3 * 62 + 1] = 5e-3
    phones = torch.zeros(4 * frames, dtype=torch.int16)
    phones[2 * frames : 2 * frames + 12] = SEGMENTS.index("p")
    mels = torch.randn(1, 4 * frames, 64, generator=random).half() - 5.0
    return EarClip(
        name, source, False, mels, motion, torch.ones_like(motion), phones, heard=heard.half()
    )  # fmt: skip


def teacher(tmp_path, layer: int | None = None) -> EarTeacher:
    """Untrained, but for a read-out whose mouth stands open."""
    torch.manual_seed(0)
    model = EarToMotion(EarConfig(width=WIDTH, channels=16, dilations=[1]), ["grid_s1"])
    with torch.no_grad():
        model.readouts[0].bias[3 * 62 + 1] = 3.0
    save(tmp_path / "ear.pt", model, sources=["grid_s1"])
    return EarTeacher(tmp_path / "ear.pt", layer)


def test_windows_of_features_fit_those_of_motion():
    clips = [clip("a", "grid_s1", 30, 0), clip("b", "grid_s1", 50, 1), clip("c", "espeak_de", 40, 2)]
    batch = EarSampler(clips, {"grid_s1": 0.7, "taught": 0.3}, 0).batch(6, 40)
    assert batch.heard.shape == (6, len(LAYERS), 80, WIDTH) and batch.phones.shape == (6, 160)
    assert batch.levels.shape == (6, 80, 8)
    opening = 10e-3 + 2e-3 * batch.heard[:, 0, ::2, 0].float()
    is_own = (lip_gap(batch.motion) - opening).abs().amax(dim=1) < 1e-4
    assert is_own.any() and not is_own.all(), "re-voiced copies have features of their own"


def test_lips_meet_where_p_is_known_and_its_features_lie_beside(tmp_path):
    speech = clip("de_0", "espeak_de", 50, 3)
    lesson = teacher(tmp_path).lesson(speech, None)
    assert (lesson.source, lesson.name) == ("taught", "espeak_de/de_0")
    gap = lip_gap(lesson.motion[:, :MOTION].float())
    assert gap[26] < 0.3e-3 and gap[10] > SCALE_M["grid_s1"]
    assert lesson.motion.shape == (50, MOTION + 16) and lesson.weight.shape == (50, MOTION + 1)


def test_unread_speech_is_taught_without_contacts(tmp_path):
    speech = clip("x", "picovoice_en", 50, 3)
    speech.phones.fill_(-1)
    lesson = teacher(tmp_path).lesson(speech, None)
    assert (lesson.phones == -1).all(), "an untrained teacher is sure of nothing"
    assert lip_gap(lesson.motion[:, :MOTION].float()).min() > SCALE_M["grid_s1"]


def test_target_of_a_layer_stands_on_the_frames_of_motion(tmp_path):
    speech = clip("x", "grid_s1", 40, 4)
    ramp = torch.arange(80.0)[:, None].expand(80, WIDTH) / 20.0
    speech.heard[0, LAYERS.index(4)] = ramp.half()
    target = teacher(tmp_path, layer=4).target(speech).float()
    expected = torch.arange(40.0)[:, None].expand(40, WIDTH) / 10.0
    torch.testing.assert_close(target[1:-1], expected[1:-1], atol=5e-3, rtol=0)


def test_silence_tells_nothing_of_features():
    entry = with_target(clip("a", "grid_s1", 60, 5), torch.ones(60, 3).half())
    options = AugmentOptions(silent_share=1.0)
    silent = TargetWindows([entry], ["grid_s1"], [1.0], 0, options).batch(2, 24)
    assert (silent.weight[..., -1] == 0).all() and (silent.weight[..., :-1] == 1).all()
    heard = TargetWindows([entry], ["grid_s1"], [1.0], 0, AugmentOptions(silent_share=0.0)).batch(2, 24)
    assert (heard.motion[..., MOTION:] == 1).all() and (heard.weight[..., -1] == 1).all()


def test_a_track_of_segments_comes_back_as_phones():
    phones = timed(torch.tensor([0] * 10 + [5] * 20 + [3] * 7))
    assert [(round(p.start_s, 2), round(p.duration_s, 2)) for p in phones] == [
        (0, 0.1),
        (0.1, 0.2),
        (0.3, 0.07),
    ]
    assert [p.label for p in phones] == [SEGMENTS[0], SEGMENTS[5], SEGMENTS[3]]


def test_phones_are_judged_outside_pauses():
    model = EarToMotion(EarConfig(width=WIDTH, channels=16, dilations=[1]), ["grid_s1"]).eval()
    with torch.no_grad():
        model.phones.readout.bias[SEGMENTS.index("p")] = 1e3
    right = phones_right(model, clip("a", "espeak_de", 40, 6))
    assert len(right) == 3 and (right == 1).all()


def test_scores_take_loudness_out():
    entry = clip("a", "grid_s1", 200, 7, voices=1)
    louder = torch.from_numpy(np.sin(np.arange(200) / 9.0)).float()
    entry.mels = (entry.mels.float() * 0.0 - 6.0 + louder.repeat_interleave(4)[None, :, None]).half()
    entry.motion[:, 3 * 66 + 1] -= 4e-3 * louder
    by_loudness = torch.zeros(200, MOTION)
    by_loudness[:, 3 * 62 + 1] = 1e-3 * louder
    perfect, loud = (strangers.scores([(motion, entry)]) for motion in (entry.motion, by_loudness))
    assert min(perfect["gap r"], perfect["gap speech"], perfect["gap beyond"]) > 0.999
    assert abs(perfect["gap slope"] - 1.0) < 1e-5
    assert loud["gap r"] > 0.7 and abs(loud["gap beyond"]) < 0.2


def test_a_denoiser_hears_another_encoder_as_its_own():
    torch.manual_seed(1)
    old, new = (CompactEncoder(debug_config()).eval() for _ in range(2))
    new.load_state_dict(old.state_dict())
    order = torch.randperm(16)
    with torch.no_grad():
        new.norm.weight.copy_(torch.linspace(0.5, 2.0, 16))
        new.norm.bias.copy_(torch.randn(16))
    mels = [torch.randn(80, 64) for _ in range(4)]
    matrix, shift, met = feature_map(old, new, mels)
    assert met > 0.999
    layer = torch.nn.Linear(16, 5)
    heard = folded(layer, matrix[:, order], shift)(new(mels[0][None])[..., order])
    torch.testing.assert_close(heard, layer(old(mels[0][None])), atol=5e-3, rtol=0)


def test_closures_are_met_or_false_where_they_stand():
    fps, motion = 50.0, np.zeros((100, 68, 3))
    motion[:, 61:64, 1] = 5e-3
    labels = ["_", "a", "p", "a", "b", "a", "_"]
    starts = [0.0, 0.2, 0.5, 0.6, 0.9, 1.0, 1.8]
    said = [Phone(s, e - s, x) for s, e, x in zip(starts, [*starts[1:], 2.0], labels, strict=True)]
    for second in (0.06, 0.5, 1.4):
        motion[int(second * fps), 61:64, 1] = 0.0
    counted = strangers.count_closures(motion, fps, said)
    assert (counted.said, counted.met, counted.false) == (2, 1, 1)
    assert counted.seconds == pytest.approx(1.4, abs=0.05)
    said[5] = Phone(said[5].start_s, said[5].duration_s, "β")
    assert strangers.count_closures(motion, fps, said).false == 0, "both lips come near in β"
    said[5] = Phone(said[5].start_s, said[5].duration_s, "a")
    motion[45, 61:63, 1] = 0.0
    assert strangers.count_closures(motion, fps, said).met == 1, "all three pairs have to meet"
    motion[45, 63, 1] = 0.4e-3
    assert (counted + strangers.count_closures(motion, fps, said)).met == 3
