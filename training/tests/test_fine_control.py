"""Metrics of fine control on arrays made by hand, and the whole report on a tiny run."""

import json
import math

import numpy as np
import pytest
import torch

from training.corpus.action_units import LOWER, channels
from training.corpus.faces import CHANNELS
from training.corpus.phones import BILABIALS
from training.export import export
from training.systems.cafe_talk import evaluate as evaluate_cafe_talk
from training.systems.cafe_talk.fine_control import engine_rates, metrics, units
from training.systems.cafe_talk.fine_control.trial import Actor, Take, TakeControl
from training.tests.test_cafe_talk import run


def peak() -> torch.Tensor:
    """0.1 before frame 10, 0.5 with a peak of 0.9 within 10 to 15, 0.3 behind; 25 frames."""
    values = torch.full((25,), 0.3)
    values[:10], values[10:15], values[12] = 0.1, 0.5, 0.9
    return values


def weights(frames: int = 60, **channels: float) -> torch.Tensor:
    """Weights [T, 51] that rest, but for the named channels."""
    out = torch.zeros(frames, len(CHANNELS))
    for name, value in channels.items():
        out[:, CHANNELS.index(name)] = value
    return out


def test_control_rate_is_the_peak_over_ten_neighbours():
    assert metrics.control_rate(peak(), (10, 15)) == pytest.approx(0.9 - 0.2)
    assert metrics.control_rate(peak(), (0, 10)) == pytest.approx(0.1 - 0.58)
    assert math.isnan(metrics.control_rate(peak(), (0, 25)))
    assert math.isnan(metrics.control_rate(peak(), (30, 40)))


def test_leak_is_what_goes_beyond_as_a_share():
    controlled, without = torch.zeros(25), torch.zeros(25)
    controlled[10:15], controlled[15], controlled[20] = 0.8, 0.8, 9.0
    assert metrics.leak(controlled, without, (10, 15)) == pytest.approx(0.1)
    assert math.isnan(metrics.leak(controlled, controlled, (10, 15)))


def test_far_change_looks_ten_frames_away_alone():
    controlled = weights()
    controlled[20:45, 3] = 0.7
    assert metrics.far_change(controlled, weights(), (30, 35)) == 0.0
    controlled[19, 7] = -0.2
    assert metrics.far_change(controlled, weights(), (30, 35)) == pytest.approx(0.2)
    assert math.isnan(metrics.far_change(controlled, weights(), (0, 60)))


def test_a_unit_is_the_mean_of_its_channels_on_both_sides():
    assert metrics.unit_values(weights(eyeBlinkLeft=0.8), "45")[0] == pytest.approx(0.4)
    assert metrics.unit_values(weights(jawOpen=0.8), "26")[0] == pytest.approx(0.8)


def test_the_command_is_measured_unit_by_unit_and_way_by_way():
    class Performer:
        """A command whose events last as long as their slot, and half as strong if they are printed."""

        def weights(self, clip, *flags: str) -> tuple[np.ndarray, np.ndarray]:
            made, moved = np.zeros((75, len(CHANNELS)), np.float32), np.zeros((75, 204), np.float32)
            if "--event" in flags:
                unit = flags[flags.index("--event") + 1].split(":")[1]
                strength = 0.5 if "printed" in flags else 1.0
                for side in (0, 1):
                    made[25:45, channels(unit, side)] = strength
                moved[25:45, 3 * 62 + 1] = 1e-3 * strength * (unit in LOWER)
            return made, moved

    page = engine_rates.page(engine_rates.measure(Performer(), [None, None]), 2)
    whole, half = "1.00 (1.00 to 1.00) | {:.1f}", "0.50 (0.50 to 0.50) | {:.1f}"
    for name, mm in (("unit 1", 0.0), ("unit 26", 1.0), ("**lower units**", 1.0)):
        cells = [whole.format(mm)] * 3 + [half.format(0.5 * mm)]
        assert f"| {name} | 0.00 | {' | '.join(cells)} |" in page


def test_closures_are_counted_within_the_slot():
    phones = torch.full((240,), -1, dtype=torch.int16)
    phones[4 * 30 : 4 * 33], phones[4 * 50 : 4 * 53] = int(BILABIALS[0]), int(BILABIALS[0])
    open_ = weights(jawOpen=0.6)
    assert metrics.closures(open_, phones, (20, 45)) == (1, 0)
    open_[31] = weights(1, mouthClose=0.2)[0]
    assert metrics.closures(open_, phones, (20, 45)) == (1, 1)


def test_lip_gap_r_and_amplitude_hear_the_jaw_alone():
    true = weights()
    true[:, CHANNELS.index("jawOpen")] = torch.linspace(0.0, 0.6, 60)
    half = true * 0.5 + weights(browDownLeft=0.5)
    assert metrics.gap_r(half, true) == pytest.approx(1.0, abs=1e-4)
    assert metrics.gap_slope(half, true) == pytest.approx(0.5, abs=1e-2)
    share = metrics.amplitude_mm(half, (20, 40), True) / metrics.amplitude_mm(true, (20, 40), True)
    assert share == pytest.approx(0.5, abs=1e-3)


def test_scores_and_summary_of_a_unit_put_on_by_addition():
    jaw = torch.sin(torch.arange(60) * 0.9).abs()[:, None] * weights(jawOpen=0.4)
    take = Take("a", "s", torch.zeros(60, 4), jaw, torch.full((240,), -1))
    controlled = {}
    for beta in units.BETAS:
        added = jaw.clone()
        added[20:40] += 0.4 * beta * weights(20, mouthSmileLeft=1.0, mouthSmileRight=1.0)
        controlled[beta] = [added]
    scores = units.score("12", [take], [jaw], controlled)
    assert scores.grows and scores.control_rate["1.0"] == pytest.approx(0.4)
    assert (scores.none, scores.leak, scores.far, scores.closures) == (0.0, 0.0, 0.0, 0)
    row = units.summary([scores])
    assert row["control rate"] == pytest.approx(0.4) and math.isnan(row["r lost upper"])
    falling = {beta: controlled[max(units.BETAS) + min(units.BETAS) - beta] for beta in units.BETAS}
    assert not units.score("12", [take], [jaw], falling | {1.0: controlled[1.5]}).grows


def test_a_run_without_a_part_is_sampled_like_the_run_beside_it(tmp_path):
    trained = run(tmp_path, "--out", tmp_path / "base", "--steps", 2)
    folder = export("cafe_talk", tmp_path / "models", run=trained, steps=1, temperature=1.0)[-1]
    flags = ["--run", folder, "--corpus", tmp_path / "corpus/made_up", "--out", tmp_path / "report"]
    flags += ["--units", "12", "--clips", 1, "--few", 1, "--judge-steps", 1, "--only", "ablations"]
    evaluate_cafe_talk.main([str(f) for f in [*flags, "--ablation", f"trained={trained}"]])
    exported, _, other = json.loads((tmp_path / "report/report.json").read_text())["ablations"]
    assert Actor(trained).config.sampling != Actor(folder).config.sampling
    assert other["control rate"] == pytest.approx(exported["control rate"], abs=1e-3)


@pytest.mark.slow
def test_the_report_of_a_tiny_run_has_every_table(tmp_path):
    base = run(tmp_path, "--out", tmp_path / "base", "--steps", 2)
    flags = ["--run", base, "--corpus", tmp_path / "corpus/made_up", "--out", tmp_path / "report"]
    flags += ["--units", "12", "45", "--clips", 1, "--few", 1, "--judge-steps", 2]
    evaluate_cafe_talk.main([str(f) for f in [*flags, "--ablation", f"the same={base}"]])
    report = json.loads((tmp_path / "report/report.json").read_text())
    assert set(report) == set(evaluate_cafe_talk.TITLES)
    assert [row["unit"] for row in report["units"]] == ["12", "45"]
    assert all(row["control_rate"]["1.0"] == pytest.approx(row["none"]) for row in report["units"])
    assert report["ablations"][0].keys() == report["ablations"][2].keys()
    page = (tmp_path / "report/report.md").read_text()
    assert all(title in page for title in evaluate_cafe_talk.TITLES.values())


def test_an_exported_folder_performs_as_its_run(tmp_path):
    trained = run(tmp_path, "--out", tmp_path / "base", "--steps", 2)
    written, read = Actor(trained), Actor(export("cafe_talk", tmp_path / "models", run=trained)[-1])
    take = Take("a", "s", torch.randn(60, written.config.speech.channels), weights(), torch.full((240,), -1))
    control = TakeControl("12", 1.0, "happy", 1.0)
    close, other = read.perform(take, control), read.perform(take, TakeControl("12", 1.0, "sad", 1.0))
    assert torch.allclose(written.perform(take, control), close, atol=5e-3)
    assert not torch.allclose(other, close, atol=1e-4)


@pytest.mark.slow
def test_events_guide_the_slot_and_nothing_is_told_where_the_label_is_masked(tmp_path):
    actor = Actor(run(tmp_path, "--out", tmp_path / "base", "--steps", 2))
    for block in actor.model.adapter.blocks:
        torch.nn.init.normal_(block.zero.weight, std=0.3)
    torch.nn.init.normal_(actor.model.coarse.null, std=1.0)
    take = Take("a", "s", torch.randn(60, actor.config.speech.channels), weights(), torch.full((240,), -1))
    plain = actor.perform(take)
    controlled = actor.perform(take, TakeControl("12", 1.0))
    assert not torch.equal(controlled, plain)
    assert not torch.equal(actor.perform(take, TakeControl("12", 1.0, unmasked=True)), controlled)
    assert not torch.equal(actor.perform(take, TakeControl("12", 1.0, printed=True)), controlled)
    masked = {"intensity": 1.0, "labelled": False}
    happy, sad = (actor.perform(take, TakeControl(emotion=e, **masked)) for e in ("happy", "sad"))
    assert torch.equal(happy, sad) and not torch.equal(happy, plain)
