"""A training run that survives an interruption: its checkpoint, its log and its progress.

`last.pt` holds every state that the next step depends on, random numbers included, so that a resumed
run gives the same bits as one that was never stopped.
"""

from __future__ import annotations

import argparse
import csv
import inspect
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, Protocol, get_args, get_origin

import numpy as np
import torch

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
            wanted, got = len(saved["random"]), self.machine.processes
            raise ValueError(f"{path}: expected {wanted} processes as before, got {got}")
        random = saved["random"][self.machine.rank]
        torch.set_rng_state(random["torch"])
        if torch.cuda.is_available() and random["cuda"] is not None:
            torch.cuda.set_rng_state(random["cuda"])
        for name, generator in self.generators.items():
            _restore(generator, random[name])
        return saved["step"]

    def save(self, step: int) -> None:
        """Writes `last.pt` after `step` steps; an interrupted write leaves the one before."""
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
        """After step number `step` (from 0): progress with the time left, and the checkpoint when due."""
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
        """Since the run began or went on."""
        return round(time.monotonic() - self.started)

    def log(self, record: dict) -> None:
        """Adds a row to `log.csv`, and to TensorBoard where asked for; new columns join at the right."""
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


def add_flags(parser: argparse.ArgumentParser, function: Callable) -> None:
    """A flag for each parameter of a function; with `Annotated` the second part is what `--help` says."""
    for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
        kind, told = parameter.annotation, None
        if get_origin(kind) is Annotated:
            kind, told = get_args(kind)
        options = {"help": told, "default": parameter.default}
        if parameter.default is parameter.empty:
            options |= {"default": None, "required": True}
        if get_origin(kind) is Literal:
            options["choices"] = get_args(kind)
        elif kind is bool:
            options["action"] = "store_true"
        elif get_origin(kind) is list:
            options |= {"type": get_args(kind)[0], "nargs": "*"}
        else:
            options["type"] = next(part for part in (*get_args(kind), kind) if part is not type(None))
        parser.add_argument(f"--{name.replace('_', '-')}", **options)


def command(function: Callable, given: list[str] | None = None) -> None:
    """Calls a function with what the command line says of its parameters."""
    parser = argparse.ArgumentParser(description=(function.__doc__ or "").splitlines()[0])
    add_flags(parser, function)
    function(**vars(parser.parse_args(given)))
