"""Where and how a run computes: devices, precision, several processes, and the recipe of the paper."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from training import REPOSITORY
from training.losses import motion_loss as landmark_loss
from training.machine import Machine
from training.systems.facetalk import motion
from training.systems.freetalk import recipes
from training.systems.freetalk.ats import CONFIGS, AtsDenoiser, neutral_affect
from training.systems.freetalk.sampling import sample_motion
from training.systems.freetalk.stm.train_paper import motion_loss
from training.systems.freetalk.train import AtsTrainer, parser, speech_source, start, steps_of, train
from training.tests.made_up import made_up

FLAGS = ["--config", "debug", "--validation-clips", "0"]


@pytest.fixture(scope="module")
def corpus(tmp_path_factory) -> Path:
    """Six clips of 2 s."""
    return made_up(tmp_path_factory.mktemp("corpus") / "made_up", 2.0)


def trained(corpus: Path, out: Path, *more: str) -> dict[str, torch.Tensor]:
    """The denoiser's weights after a training in this process."""
    flags = ["--corpus", str(corpus), "--out", str(out), *FLAGS, *more]
    return torch.load(train(parser().parse_args(flags)))["state"]


def test_what_is_not_there_is_refused():
    if not torch.cuda.is_available():
        with pytest.raises(ValueError, match="expected a GPU that PyTorch sees for cuda, got none"):
            Machine("cuda")
    with pytest.raises(ValueError, match="expected float32 or bfloat16 on a processor, got float16"):
        Machine("cpu", "float16")


@pytest.mark.slow
def test_precision_is_what_was_asked_for(corpus, tmp_path):
    exact = trained(corpus, tmp_path / "exact", "--steps", "2", "--device", "cpu", "--precision", "float32")
    rough = trained(corpus, tmp_path / "rough", "--steps", "2", "--device", "cpu")
    difference = (exact["head.weight"] - rough["head.weight"]).abs().max()
    assert 0.0 < difference < 1e-2


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("accelerate") is None, reason="ignored: no accelerate")
def test_two_processes_train_as_one_and_go_on_with_the_same_bits(corpus, tmp_path):
    def launch(out: str, *more: str) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]
        command += ["-m", "training.systems.freetalk.train", *FLAGS, "--device", "cpu", "--steps", "4"]
        flags = ["--corpus", corpus, "--out", tmp_path / out, *more]
        for _ in range(6):
            done = subprocess.run(
                [*command, *map(str, flags)], cwd=REPOSITORY, capture_output=True, text=True
            )
            # PyTorch's own threads abort a process that is done now and then; what it wrote is there.
            if "terminate called without an active exception" not in done.stderr:
                break
        return done

    for out, more in (("whole", ()), ("parts", ("--stop-at", "2")), ("parts", ())):
        done = launch(out, *more)
        assert done.returncode == 0, done.stderr[-2000:]
    whole, parts = (torch.load(tmp_path / out / "ats.pt")["state"] for out in ("whole", "parts"))
    assert all(torch.equal(value, parts[name]) for name, value in whole.items())
    alone = trained(corpus, tmp_path / "alone", "--steps", "4")
    assert not torch.equal(alone["head.weight"], whole["head.weight"])
    with pytest.raises(ValueError, match="expected 2 processes as before, got 1"):
        trained(corpus, tmp_path / "parts", "--steps", "4")


def equation_15(error: torch.Tensor, velocity: float, acceleration: float) -> float:
    """The printed loss, term by term; `error` [T, K, 3] is Ŷ − Y."""
    frames, points = error.shape[:2]
    v = [error[t + 1] - error[t] for t in range(frames - 1)]
    a = [error[t + 2] - 2 * error[t + 1] + error[t] for t in range(frames - 2)]
    terms = [(1.0, list(error)), (velocity, v), (acceleration, a)]
    return sum(w * sum(float((x**2).sum()) for x in of) / (len(of) * points) for w, of in terms)


def test_losses_of_the_paper_are_those_printed():
    error = torch.randn(7, 68, 3, dtype=torch.float64)
    stm, ats = recipes.STM["paper"], recipes.ATS["paper"]
    loss = motion_loss(error, stm)
    assert float(loss) == pytest.approx(100.0 * equation_15(error, 0.5, 0.2))
    flat, shares = error.flatten(1)[None], (ats.velocity, ats.acceleration)
    loss = 3.0 * landmark_loss(flat, torch.ones_like(flat), *shares)
    assert float(loss) == pytest.approx(equation_15(error, 0.3, 0.1))


def test_the_recipe_of_the_paper_reaches_the_optimiser(corpus, tmp_path):
    flags = ["--corpus", str(corpus), "--out", str(tmp_path), *FLAGS, "--recipe", "paper", "--device", "cpu"]
    arguments = parser().parse_args(flags)
    config = CONFIGS["debug"]()
    config.styles = ["made_up", "any"]
    trainer = AtsTrainer(arguments, config, speech_source(arguments, config))
    trainer.speech.entries *= 40
    run = start(arguments, trainer, steps := 100 * 4 * 40 // 16)
    arguments.config = "compact"
    assert steps_of(arguments, trainer) == steps
    optimiser, schedule = run.parts["optimiser"], run.parts["schedule"]
    for _ in range(20):
        optimiser.step()
        schedule.step()
    group = optimiser.param_groups[0]
    assert (group["lr"], group["weight_decay"]) == (1e-4, 1e-2)
    step = trainer.draw(4, 24)
    assert set(step.source.tolist()) == {1} and set(step.weight.unique().tolist()) <= {0.0, 1.0}
    assert trainer.loss(step)[0].item() > 0.0


def test_samplers_compute_where_the_model_is():
    ats = AtsDenoiser(CONFIGS["debug"]()).to("meta")
    sound, affect = torch.randn(40, ats.config.speech.channels), neutral_affect(1, 40)[0]
    assert sample_motion(ats, sound, affect, 0).device.type == "meta"
    codes = motion.Denoiser(motion.debug_config()).to("meta")
    assert motion.sample(codes, torch.randn(12, codes.config.speech.channels)).device.type == "meta"
