"""The paper's tables from a made-up corpus folder."""

import os
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from training import REPOSITORY
from training.corpus.folder import CorpusFolder
from training.engine import Engine
from training.paper import ablations
from training.paper.__main__ import page
from training.paper.figures import attention_in_numbers
from training.paper.metrics import NAMES, measure, path_costs
from training.paper.printed import WHOLE, combinations
from training.paper.tables import Table, landmark_table, mesh_tables
from training.systems.freetalk.ats import debug_config, neutral_affect
from training.tests.made_up import made_up

BINARY = Path(os.environ.get("ANYFACE_BINARY", REPOSITORY / "target/debug/anyface"))
needs_binary = pytest.mark.skipif(not BINARY.exists(), reason="ignored: no anyface to call")
REFERENCE = {
    "LVE": 16.15426070527576,
    "MVE": 2.273892725676091,
    "FDD": 0.16922161887562126,
    "DTW": 280.9872906304126,
    "DFD": 9.894959868823797,
    "δM": 12.325947934586463,
    "δCd": 1.01146473750219,
}
"""Scores that torchmetrics, similaritymeasures and numpy give for the arrays of
tests/goldens/metrics.safetensors.
"""


def test_metrics_are_those_of_other_libraries():
    arrays = load_file(REPOSITORY / "tests/goldens/metrics.safetensors")
    scores = measure(*(arrays[name] for name in ("prediction", "truth", "lips", "upper")))
    assert scores.keys() == set(NAMES)
    for name, value in REFERENCE.items():
        assert scores[name] == pytest.approx(value, rel=1e-9), name


def test_the_truth_itself_is_faultless():
    truth = np.random.default_rng(0).standard_normal((9, 68, 3))
    scores = measure(truth, truth, np.arange(48, 68), np.arange(17, 27))
    assert all(abs(value) < 1e-9 for value in scores.values()), scores


@needs_binary
def test_landmarks_of_a_folder_become_a_table(tmp_path):
    folder = CorpusFolder(made_up(tmp_path / "made_up", seconds=2.0))
    table = landmark_table(folder, Engine(BINARY), count=1)
    assert list(table.rows)[:2] == ["nothing moves", "Anyface"]
    assert "Anyface, without the label" in table.rows
    assert table.rows["nothing moves"]["δCd"] == 1.0
    assert all(np.isfinite(list(scores.values())).all() for scores in table.rows.values())


def test_a_folder_without_held_out_motion_gives_no_table(tmp_path):
    path = made_up(tmp_path / "made_up", seconds=1.0)
    clips = path / "clips.tsv"
    clips.write_text(clips.read_text().replace("\ttest\t", "\ttrain\t"))
    assert landmark_table(CorpusFolder(path), Engine(BINARY), count=1) is None
    assert mesh_tables(CorpusFolder(path), Engine(BINARY), count=1) == []


def test_the_page_names_units_and_leaves_out_what_was_not_seen(tmp_path):
    scores = dict.fromkeys(NAMES, 1.2345) | {"FDD": float("nan")}
    table = Table("mine", "landmarks", {"Anyface": scores}, 3, 68)
    text = page([table], [], [], tmp_path / "paper.md", "python -m training.paper")
    assert "| Anyface | 1.23 |" in text and "| – |" in text and "LVE mm²" in text


def test_equal_shares_of_attention_read_as_all_landmarks_and_one_landmark_as_one():
    equal = attention_in_numbers(np.full((5, 68), 1 / 68))
    assert "Equal shares would be 0.015" in equal and "attends to 68.0 of 68" in equal
    one = attention_in_numbers(np.eye(68)[[50, 50, 8]])
    assert "attends to 1.0 of 68" in one and "gives 1.00 to the first" in one


def test_a_figure_is_followed_by_its_numbers(tmp_path):
    image = tmp_path / "images/attention.png"
    text = page([], [], [(image, "One sentence.")], tmp_path / "paper.md", "made")
    assert "## Figures" in text and "(images/attention.png)\n\nOne sentence.\n" in text


def test_ablations_stand_beside_the_printed_shares(tmp_path):
    lves = {WHOLE: 20.0, "without the landmark graph": 25.0, "without cross-attention": 50.0}
    rows = {name: dict.fromkeys(NAMES, 1.0) | {"LVE": lve} for name, lve in lves.items()}
    assert rows.keys() <= ablations.STM.keys()
    text = page([], [Table("Ablations", "mesh", rows, 1, 9)], [], tmp_path / "paper.md", "made")
    assert "| Concat. | 1.67 | 2.50 |" in text and "| CA + Concat. | 1.10 | 1.25 |" in text
    assert "| CA | 1.19 | – |" in text and "| GCN + CA + Concat. | 1.00 | 1.00 |" in text
    seeds = {
        f"{name}, seed {k}": rows[name] | {"LVE": lve + 4 * k} for name, lve in lves.items() for k in (0, 1)
    }
    text = page([], [Table("Ablations", "mesh", seeds, 1, 9)], [], tmp_path / "paper.md", "made")
    assert "Means of 2 seeds" in text and "| Concat. | 1.67 | 2.36 (2.27 to 2.45) |" in text
    assert "MEAD-EMOTE (table 2" in text and combinations([]) == ""


@pytest.mark.parametrize("kind", list(ablations.ATS.values())[1:])
def test_what_a_denoiser_lacks_makes_no_difference_to_it(kind):
    torch.manual_seed(0)
    model = kind(debug_config()).eval()
    noisy, speech = torch.randn(1, 20, 204), torch.randn(1, 20, 16)
    affect = neutral_affect(1, 20)
    affect[..., 0], affect[..., 1], affect[..., -1] = 0.0, 1.0, 0.4
    stronger = affect.clone()
    stronger[..., -1] = 1.2
    style = torch.tensor([0])

    def run(model, t=100, emotion=affect, heard=speech):
        with torch.no_grad():
            return model(noisy, torch.tensor([t]), heard, emotion, style)

    whole = ablations.AtsDenoiser(debug_config()).eval()
    whole.load_state_dict(model.state_dict())
    far = speech.clone()
    far[:, 0] += 5.0
    changes = {
        ablations.WithoutTime: {"t": 900},
        ablations.WithoutIntensity: {"emotion": stronger},
        ablations.WithoutBand: {},
    }[kind]
    if changes:
        assert torch.equal(run(model), run(model, **changes))
        assert not torch.equal(run(whole), run(whole, **changes))
    else:
        last = (0, 19)
        one_layer = debug_config()
        one_layer.layers = 1
        near, wide = ablations.AtsDenoiser(one_layer).eval(), kind(one_layer).eval()
        assert not torch.equal(run(wide)[last], run(wide, heard=far)[last])
        band = near.config.radius
        assert band < 19 and wide.config.radius >= 19


def test_the_cheapest_path_is_that_of_a_loop():
    between = np.random.default_rng(0).random((7, 5))
    for joined in (np.add, np.maximum):
        cost = np.full((8, 6), np.inf)
        cost[0, 0] = 0.0
        for i in range(7):
            for j in range(5):
                before = min(cost[i, j + 1], cost[i + 1, j], cost[i, j])
                cost[i + 1, j + 1] = joined(between[i, j], before)
        np.testing.assert_array_equal(path_costs(between, joined), cost)
