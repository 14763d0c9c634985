"""Cafe-Talk: sizes, an adapter that begins as nothing, the frozen base, runs that go on bit for bit."""

from pathlib import Path

import numpy as np
import pytest
import torch

from training import shipped
from training.corpus.action_units import (
    STEMS,
    active_units,
    channels,
    merged,
    random_events,
    runs,
    sparse,
    unit_matrix,
)
from training.corpus.conditions import EMOTIONS, SIDES, UNITS
from training.corpus.emotion_weights import with_emotion
from training.corpus.faces import CHANNELS
from training.export import export
from training.systems.cafe_talk import stored
from training.systems.cafe_talk import train as train_cafe_talk
from training.systems.cafe_talk.denoiser import CONFIGS, Coarse, Denoiser
from training.systems.cafe_talk.priority import yielding
from training.tests.made_up import made_up
from training.text.emotions import SYNONYMS
from training.text.golden_clip import write_folder
from training.text.space import BUCKETS
from training.text.stored import load_places


def little_space(folder: Path) -> Path:
    """A text space of the words for emotions at random places."""
    random = np.random.default_rng(4)
    words = sorted({word for synonyms in SYNONYMS.values() for word in synonyms})
    space = {"words": np.array(words), "vectors": random.standard_normal((len(words), 64)).astype(np.float16)}
    np.savez(folder / "space.npz", **space, ngrams=random.standard_normal((BUCKETS, 64)).astype(np.float16))
    return folder


def run(folder: Path, *flags: str | Path) -> Path:
    """A debug run on a made-up folder; its cafe_talk.pt."""
    corpus = folder / "corpus" / "made_up"
    if not corpus.exists():
        made_up(corpus, 2.0)
        little_space(folder)
    line = [
        "--corpus",
        corpus,
        "--config",
        "debug",
        "--text",
        folder,
        "--tokens",
        96,
        "--validation-clips",
        0,
    ]
    return train_cafe_talk.train(train_cafe_talk.parser().parse_args([str(x) for x in [*line, *flags]]))


def state(path: Path) -> dict[str, torch.Tensor]:
    """The weights of a run."""
    return torch.load(path)["state"]


def inputs(model: Denoiser, frames: int = 12) -> dict:
    """One row of noise under every condition."""
    config = model.config
    torch.manual_seed(3)
    coarse = Coarse(
        torch.tensor([0]), torch.randn(1, frames, config.text_width), torch.rand(1, frames), torch.ones(1) > 0
    )
    return {
        "noisy": torch.randn(1, frames, len(config.channels)),
        "timestep": torch.tensor([500]),
        "speech": torch.randn(1, frames, config.speech.channels),
        "coarse": coarse,
        "speech_given": torch.ones(1) > 0,
    }


@pytest.mark.parametrize("kind", ["built in", "clip"])
def test_the_text_space_is_the_built_in_one_or_clips(tmp_path, kind):
    places = shipped("text_units")
    if kind == "clip":
        write_folder(tmp_path / "clip", width=32)
        places = tmp_path / "clip"
    chosen = () if kind == "built in" else ("--text", places)
    made_up(tmp_path / "corpus", 2.0)
    line = ["--corpus", tmp_path / "corpus", "--config", "debug", "--tokens", 96, "--validation-clips", 0]
    line += [*chosen, "--steps", 2, "--out", tmp_path / "out"]
    saved = torch.load(train_cafe_talk.train(train_cafe_talk.parser().parse_args(list(map(str, line)))))
    expected = load_places(places)
    assert saved["config"]["text_width"] == expected.width == {"built in": 64, "clip": 32}[kind]
    assert np.array_equal(saved["emotions"].numpy(), expected.emotions())
    lengths = np.linalg.norm(expected.of("furious") - expected.emotions(), axis=1)
    assert kind == "clip" or EMOTIONS[int(lengths.argmin())] == "angry"


def test_a_folder_that_is_no_text_space_is_refused_with_the_way_out(tmp_path):
    (tmp_path / "config.json").write_text('{"model_type": "hubert"}')
    with pytest.raises(
        ValueError, match="expected space.npz .* got a config.json of hubert; leave --text out"
    ):
        load_places(tmp_path)
    with pytest.raises(ValueError, match="got neither file"):
        load_places(tmp_path / "nothing")


@pytest.mark.parametrize("name,base,adapter", [("paper", 25.1, 5.4), ("compact", 1.6, 0.4)])
def test_sizes_are_those_of_the_paper(name, base, adapter):
    model = Denoiser(CONFIGS[name]())
    count = lambda parameters: sum(p.numel() for p in parameters) / 1e6  # noqa: E731
    sizes = count(model.base_parameters()), count(model.adapter.parameters())
    if name == "paper":
        assert sizes == (pytest.approx(base, rel=0.03), pytest.approx(adapter, rel=0.03))
    assert sizes[0] + sizes[1] == pytest.approx(count(model.parameters()))


def test_an_adapter_of_zeros_changes_no_bit():
    model = Denoiser(CONFIGS["debug"]()).eval()
    arguments = inputs(model)
    events = torch.ones(1, 12, SIDES * len(UNITS))
    with torch.no_grad():
        assert torch.equal(model(*arguments.values(), events), model(*arguments.values()))
        torch.nn.init.ones_(model.adapter.blocks[0].zero.weight)
        assert not torch.equal(model(*arguments.values(), events), model(*arguments.values()))


def test_the_second_stage_trains_the_adapter_alone(tmp_path):
    base = run(tmp_path, "--out", tmp_path / "base", "--steps", 3)
    fine = run(tmp_path, "--out", tmp_path / "fine", "--steps", 3, "--base", base)
    before, after = state(base), state(fine)
    changed = {name for name in before if not torch.equal(before[name], after[name])}
    assert changed and all(name.startswith(("adapter.", "mean", "std")) for name in changed)
    assert not {"mean", "std"} & changed


def test_an_exported_folder_is_a_base_like_the_run_that_it_came_from(tmp_path):
    fine = run(tmp_path, "--out", tmp_path / "fine", "--steps", 2, "--one-stage")
    folder = export("cafe_talk", tmp_path / "models", run=fine)[-1]
    begun = run(tmp_path, "--out", tmp_path / "begun", "--steps", 2, "--base", folder)
    before, after = stored.load(folder), state(begun)
    assert all(torch.equal(value, after[name]) for name, value in before.base.items())
    assert before.state["head.weight"].dtype == torch.float32
    moved = {name for name in after if not torch.equal(before.state[name], after[name])}
    assert moved and all(name.startswith("adapter.") for name in moved)
    whole = stored.load(fine)
    assert torch.equal(whole.state["head.weight"].half().float(), before.state["head.weight"])
    assert torch.equal(whole.emotions.half().float(), before.emotions)


def test_in_one_stage_base_and_adapter_learn_together(tmp_path):
    base = run(tmp_path, "--out", tmp_path / "base", "--steps", 2)
    joint = run(tmp_path, "--out", tmp_path / "joint", "--steps", 3, "--base", base, "--one-stage")
    before, after = state(base), state(joint)
    changed = {name.partition(".")[0] for name in before if not torch.equal(before[name], after[name])}
    assert {"adapter", "head", "coarse"} <= changed


def test_a_folder_or_base_that_does_not_fit_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match="expected a cafe_talk.pt or a model folder"):
        stored.load(tmp_path / "nowhere.pt")
    with pytest.raises(FileNotFoundError, match="expected config.json, it is missing"):
        stored.load(tmp_path)
    trained = run(tmp_path, "--out", tmp_path / "a", "--steps", 1)
    folder = export("cafe_talk", tmp_path / "models", run=trained)[-1]
    with pytest.raises(ValueError, match="expected a base with coarse film, got ada_ln"):
        run(tmp_path, "--out", tmp_path / "b", "--steps", 1, "--base", folder, "--coarse", "film")
    written = (folder / "config.json").read_text()
    (folder / "config.json").write_text(written.replace('"cafe_talk"', '"freetalk"', 1))
    with pytest.raises(ValueError, match="expected a model of cafe_talk, got one of 'freetalk'"):
        stored.load(folder)


def test_a_run_that_was_stopped_goes_on_with_the_same_bits(tmp_path):
    whole = run(tmp_path, "--out", tmp_path / "whole", "--steps", 6)
    run(tmp_path, "--out", tmp_path / "parts", "--steps", 6, "--stop-at", 3)
    parts = run(tmp_path, "--out", tmp_path / "parts", "--steps", 6)
    whole, parts = state(whole), state(parts)
    assert all(torch.equal(whole[name], parts[name]) for name in whole)


def test_what_is_exported_is_what_the_config_says(tmp_path):
    from safetensors.torch import load_file

    trained = run(tmp_path, "--out", tmp_path / "run", "--steps", 2)
    folder = export("cafe_talk", tmp_path / "models", run=trained)[-1]
    weights = load_file(folder / "model.safetensors")
    assert weights["emotions"].shape == (len(EMOTIONS), 64)
    assert weights["mean"].dtype == torch.float32 and weights["head.weight"].dtype == torch.float16


def test_every_unit_has_channels_and_shares_none_but_its_sides():
    matrix = unit_matrix()
    assert matrix.shape == (SIDES * len(UNITS), len(CHANNELS)) and (matrix.sum(dim=1) > 0).all()
    left, right = matrix.split(len(UNITS))
    for side in (left, right):
        assert (side.sum(dim=0) <= 1).all()
    assert set(UNITS) <= set(STEMS) and channels("45", 0) == [CHANNELS.index("eyeBlinkLeft")]


def test_runs_near_each_other_merge_and_far_ones_do_not():
    active = torch.zeros(40, 1)
    active[5:8], active[11:14], active[30:33] = 1.0, 1.0, 1.0
    assert runs(merged(active, 2)[:, 0]) == [(5, 14), (30, 33)]
    assert torch.equal(merged(active, 0), active)


def test_active_units_are_sparse_and_where_the_weights_are():
    random = np.random.default_rng(0)
    weights = torch.zeros(200, len(CHANNELS))
    weights[50:80, CHANNELS.index("jawOpen")] = 0.9
    active = active_units(weights, random)
    jaw = UNITS.index("26")
    assert active[55:75, jaw].all() and not active[:30].any() and not active[:, UNITS.index("12")].any()
    count = sum(bool(sparse(active, random).any()) for _ in range(200))
    assert 10 < count < 90


def test_lower_events_give_way_where_lips_meet():
    closed = torch.zeros(100)
    closed[40:60] = 1.0
    mouth = [
        i for i, c in enumerate(CHANNELS) if c.startswith(("jaw", "mouth")) and not c.startswith("mouthSmile")
    ]
    random = np.random.default_rng(1)
    events = [random_events(100, closed, random) for _ in range(200)]
    assert max(float(m.weights.max()) for m in events) > 0.9
    lower = [m for m in events if m.weights[:, mouth].any()]
    assert lower and all(not m.weights[40:60][:, mouth].any() for m in lower)


def test_jaw_and_chin_give_way_to_the_speech_and_nothing_else_does():
    jaw, chin, smile = (CHANNELS.index(c) for c in ("jawOpen", "mouthShrugLower", "mouthSmileLeft"))
    spoken = torch.full((1, 60, len(CHANNELS)), 0.02)
    spoken[0, :, CHANNELS.index("mouthClose")] = 0.0
    spoken[0, [20, 21, 30, 31, 40, 41], jaw] = 0.3
    mask = yielding(torch.full((1, 60, len(CHANNELS)), 1.5), spoken)[0]
    assert mask[20, jaw] == 1.5 and mask[26, jaw] < 0.1 and mask[26, chin] == mask[26, jaw]
    assert (mask[:8] == 1.5).all() and (mask[:, smile] == 1.5).all()


def test_emotion_grows_with_its_intensity():
    speech, closed = torch.zeros(10, len(CHANNELS)), torch.zeros(10)
    happy = torch.zeros(10, len(EMOTIONS))
    happy[:, EMOTIONS.index("happy")] = 1.0
    smile = CHANNELS.index("mouthSmileLeft")
    shown = [
        with_emotion(speech, happy, torch.full((10,), i), closed)[0, smile].item() for i in (0.0, 0.5, 1.0)
    ]
    assert shown[0] == 0.0 and shown[0] < shown[1] < shown[2]


def test_the_built_in_size_leaves_room_for_its_text_space():
    count = sum(tensor.numel() for tensor in Denoiser(CONFIGS["compact"]()).state_dict().values())
    assert 2e-6 * count < 7.0, "megabytes in 16 bits, of 10 with the text space"


def test_captures_of_weights_by_name_train(tmp_path):
    made_up(tmp_path / "corpus/made_up", 2.0, "weights")
    little_space(tmp_path)
    trained = state(run(tmp_path, "--out", tmp_path / "run", "--steps", 3))
    jaw = CHANNELS.index("jawOpen")
    assert torch.isfinite(trained["head.weight"]).all() and trained["mean"][jaw] > 0.02


@pytest.mark.slow
def test_the_recipe_of_the_paper_is_what_its_appendix_says(tmp_path):
    path = run(tmp_path, "--out", tmp_path / "out", "--recipe", "paper", "--steps", "3")
    said = torch.load(path)["recipe"]
    assert (said["rate"], said["batch"], said["base"], said["adapter"]) == (1e-4, 16, 400_000, 300_000)
    assert not said["annealed"] and said["plain"] and said["velocity"] == said["acceleration"] == 0.0
    last = torch.load(tmp_path / "out/last.pt", weights_only=False)
    assert last["optimiser"]["param_groups"][0]["lr"] == 1e-4
    assert "features" not in (tmp_path / "out/log.csv").read_text().splitlines()[0]


def test_the_shipped_model_is_loaded_with_the_shipped_encoder():
    loaded = stored.load(shipped("cafe_talk_compact"))
    assert loaded.encoder is not None and loaded.config.speech.encoder == "ear"
