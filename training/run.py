"""A training run that survives an interruption: its checkpoint, its log and its progress.

`last.pt` holds every state that the next step depends on, random numbers included, so that a resumed
run gives the same bits as one that was never stopped.
"""

import argparse
import csv
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from training import DATA
from training.machine import Machine

SHOW_EVERY_S = 5.0


class Stateful(Protocol):
    """A model, an optimiser, a schedule."""

    def state_dict(self) -> dict: ...
    def load_state_dict(self, state: dict) -> object: ...


class Run:
    """Keeps `parts` and random generators in `out/last.pt` every `save_every` steps and at the end."""

    def __init__(self, out: Path, parts: dict[str, Stateful], steps: int, save_every: int,
                 generators: dict[str, torch.Generator | np.random.Generator],
                 machine: Machine | None = None, tensorboard: bool = False):  # fmt: skip
        out.mkdir(parents=True, exist_ok=True)
        self.out, self.parts, self.steps, self.save_every = out, parts, steps, max(save_every, 1)
        self.generators, self.machine = generators, machine or Machine("cpu")
        self.parts = parts | ({"scaler": self.machine.scaler} if self.machine.scaler.is_enabled() else {})
        self.board = _board(out) if tensorboard and self.machine.rank == 0 else None
        self.first = self._resume()
        self.started = self.shown = time.monotonic()

    def _resume(self) -> int:
        path = self.out / "last.pt"
        if not path.exists():
            return 0
        saved = torch.load(path, map_location="cpu", weights_only=False)
        missing = [name for name in self.parts if name not in saved]
        if missing or "random" not in saved:
            raise ValueError(f"{path}: expected {', '.join([*self.parts, 'random'])}, got {', '.join(saved)}")
        for name, part in self.parts.items():
            part.load_state_dict(saved[name])
        if len(saved["random"]) != self.machine.processes:
            expected, got = len(saved["random"]), self.machine.processes
            raise ValueError(f"{path}: expected {expected} processes as before, got {got}")
        random = saved["random"][self.machine.rank]
        torch.set_rng_state(random["torch"])
        if torch.cuda.is_available() and random["cuda"] is not None:
            torch.cuda.set_rng_state(random["cuda"])
        for name, generator in self.generators.items():
            _restore(generator, random[name])
        return saved["step"]

    def save(self, step: int) -> None:
        """Writes `last.pt` after `step` steps. If the write is interrupted, the previous file remains."""
        random = {name: _state(generator) for name, generator in self.generators.items()}
        cuda = torch.cuda.get_rng_state() if self.machine.device.type == "cuda" else None
        random = self.machine.gathered(random | {"torch": torch.get_rng_state(), "cuda": cuda})
        if self.machine.rank > 0:
            return
        saved = {name: part.state_dict() for name, part in self.parts.items()}
        saved |= {"step": step, "random": random}
        partial = self.out / "last.partial"
        torch.save(saved, partial)
        partial.rename(self.out / "last.pt")

    def after(self, step: int, loss: float) -> None:
        """After step `step` (from 0), shows progress and the time left, and saves a checkpoint when due."""
        done, now = step + 1, time.monotonic()
        if self.machine.rank == 0 and (done == self.steps or now - self.shown > SHOW_EVERY_S):
            self.shown = now
            each = (now - self.started) / (done - self.first)
            left = f"{clock(each * (self.steps - done))} left"
            line = f"step {done} of {self.steps}, loss {loss:.4f}, {each:.2f} s a step, {left}"
            end = "\n" if done == self.steps or not sys.stderr.isatty() else "\r"
            print(line.ljust(78), end=end, file=sys.stderr, flush=True)
        if done % self.save_every == 0 or done == self.steps:
            self.save(done)

    def seconds(self) -> int:
        """Seconds since the run began or was resumed."""
        return round(time.monotonic() - self.started)

    def log(self, record: dict) -> None:
        """Adds a row to `log.csv`, and to TensorBoard with `--tensorboard`. New columns go to the right."""
        for key, value in record.items() if self.board is not None else ():
            self.board.add_scalar(key.replace(" ", "/", 1), value, record["step"])
        row = {key: f"{value:.5g}" if isinstance(value, float) else value for key, value in record.items()}
        path, rows = self.out / "log.csv", []
        if path.exists():
            with open(path, newline="") as file:
                rows = list(csv.DictReader(file))
        rows.append(row)
        heads = list(dict.fromkeys(key for r in rows for key in r))
        with open(path, "w", newline="") as file:
            writer = csv.DictWriter(file, heads)
            writer.writeheader()
            writer.writerows(rows)
        print(", ".join(f"{key} {value}" for key, value in row.items()), flush=True)


def begin(arguments, model: nn.Module, generators: dict[str, torch.Generator | np.random.Generator], *,
          groups: list[dict] | None = None, steps: int | None = None, decay: float = 0.01, warm: float = 0.1,
          factor: Callable[[int], float] | None = None, average: float | None = 0.995,
          machine: Machine | None = None, name: str = "model", extra: dict[str, Stateful] | None = None,
          **cycle: float) -> Run:  # fmt: skip
    """Starts or resumes a run with AdamW and averaged weights.

    The learning rate rises over the first `warm` share of the steps and then falls until the end. If `factor`
    is given, it multiplies the rate at each step instead. Each of the `groups` of parameters has its own
    rate; without groups all learn at `arguments.rate`. `extra` is other state that changes from step to step
    and belongs in the checkpoint.
    """
    steps = steps or arguments.steps
    groups = groups or [{"params": list(model.parameters()), "lr": arguments.rate}]
    rates = [group["lr"] for group in groups]
    optimiser = torch.optim.AdamW(groups, weight_decay=decay)
    if factor is not None:
        schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, factor)
    else:
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rates, steps + 1, pct_start=warm, **cycle)
    parts = {name: model, "optimiser": optimiser, "schedule": schedule}
    if average is not None:
        mean = torch.optim.swa_utils.get_ema_multi_avg_fn(average)
        parts["average"] = torch.optim.swa_utils.AveragedModel(model, multi_avg_fn=mean)
    board = getattr(arguments, "tensorboard", False)
    return Run(arguments.out, parts | (extra or {}), steps, arguments.save_every, generators, machine, board)


def begin_student(
    arguments, model: nn.Module, generators: dict, average: float, machine: Machine | None = None
) -> Run:
    """The run of a causal student. `debug` takes 20 steps."""
    steps = min(arguments.steps, 20) if arguments.config == "debug" else arguments.steps
    warm = max(steps // 20, 1) / steps
    return begin(
        arguments, model, generators, steps=steps, decay=0.02, warm=warm, average=average, machine=machine
    )


def descend(arguments, run: Run, loss: Callable[[int], tuple[Tensor, dict]],
            judge: Callable[[nn.Module], dict], clip: float = 1.0,
            clipped: nn.Module | None = None) -> nn.Module:  # fmt: skip
    """Runs all steps. Returns the averaged model, or the model itself if nothing is averaged.

    `loss` gets the number of a step and returns the loss and values for the log. The first process calls
    `judge` with the model every `arguments.log_every` steps and at the end; `judge` saves the model and
    returns scores for the log. Gradients of `clipped`, by default the whole model, are clipped to a norm of
    `clip`.
    """
    model, optimiser, schedule, *average = list(run.parts.values())[: 3 + ("average" in run.parts)]
    best = average[0].module if average else model
    until = min(run.steps, getattr(arguments, "stop_at", None) or run.steps)
    for step in range(run.first, until):
        value, report = loss(step)
        run.machine.step(value, clipped or model, optimiser, clip)
        schedule.step()
        for mean in average:
            mean.update_parameters(model)
        run.after(step, value.item())
        due = step % arguments.log_every == arguments.log_every - 1 or step == until - 1
        if due and run.machine.rank == 0:
            scores = judge(best)
            run.log({"step": step + 1, "s": run.seconds(), **report, **scores})
    if until < run.steps:
        run.save(until)
    return best


def downhill(loss: Tensor, optimiser: torch.optim.Optimizer, schedule=None) -> None:
    """One optimiser step, for trainings that take minutes and write no checkpoint."""
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    if schedule is not None:
        schedule.step()


def trainer_parser(doc: str, out: str, steps: int | None, rate: float | None, *, log_every: int = 150,
                   save_every: int = 50, corpus: bool = True) -> argparse.ArgumentParser:  # fmt: skip
    """A parser with the flags that every trainer has. If `rate` is None, it has no `--rate`."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    if corpus:
        parser.add_argument("--corpus", type=Path, nargs="*", default=[], help="corpus folders")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--out", type=Path, default=Path(out))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--steps", type=int, default=steps)
    if rate is not None:
        parser.add_argument("--rate", type=float, default=rate, help="learning rate")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--log-every", type=int, default=log_every)
    parser.add_argument("--save-every", type=int, default=save_every, help="steps between checkpoints")
    return parser


def seeded(arguments) -> None:
    """Sets seed and threads of a training. The same seed and number of threads give the same bits."""
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(arguments.threads)


def _board(out: Path):
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise ImportError("--tensorboard: expected the package tensorboard, got none") from None
    return SummaryWriter(str(out))


def clock(seconds: float) -> str:
    """Hours, minutes and seconds."""
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def _state(generator: torch.Generator | np.random.Generator):
    return generator.get_state() if isinstance(generator, torch.Generator) else generator.bit_generator.state


def _restore(generator: torch.Generator | np.random.Generator, state) -> None:
    if isinstance(generator, torch.Generator):
        generator.set_state(state)
    else:
        generator.bit_generator.state = state
