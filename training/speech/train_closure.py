"""Fits the read-out that tells when the lips are together, on a finished run's encoder.

    python -m training.speech.train_closure --data ../shared/data --run runs/ats/ats.pt

A closure lasts only a frame or two of video. Smoothing opens it and a squared error blurs it. So a logistic
read-out of the encoder's features detects p, b and m in the sound itself. It trains on all speech with
phones: the project's, or with `--corpus DIR [DIR ...]` the clips of corpus folders that have
`phones/CLIP.tsv`. The run's file is rewritten with the read-out.
"""

import argparse
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from training.corpus import bank, spoken
from training.corpus.phones import BILABIALS
from training.corpus.shares import lasting, with_phones
from training.corpus.teacher import Teacher
from training.corpus.windows import AugmentOptions, WindowSampler
from training.run import downhill, seeded
from training.speech.compact import CompactConfig, CompactEncoder
from training.speech.targets import windows_of

EARLY_MEL_FRAMES = 3
"""Lips already meet this many mel frames (30 ms) before the sound of p, b and m begins."""
POSITIVE_WEIGHT = 3.0
FRAMES = 96
SHARES = {"grid_s1": 0.25, "taught": 0.75}


def closed_share(phones: Tensor) -> Tensor:
    """`phones` [B, 4 T] segments → the share of each motion frame in which the lips are together, [B, T]."""
    inside = torch.isin(phones, torch.tensor(BILABIALS))
    early = inside.clone()
    for shift in range(1, EARLY_MEL_FRAMES + 1):
        early[:, :-shift] |= inside[:, shift:]
    return windows_of(early).float().mean(dim=2)


def fit(encoder: CompactEncoder, sampler: WindowSampler, steps: int, batch: int) -> None:
    """Trains the read-out; the rest of the encoder stays as it is."""
    readout = encoder.closure
    torch.nn.init.zeros_(readout.bias)
    optimiser = torch.optim.Adam(readout.parameters(), 1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in range(steps):
        window = sampler.batch(batch, FRAMES)
        known = (window.phones >= 0).all(dim=1)
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
            features = encoder(window.mel[known]).float()
        loss = F.binary_cross_entropy_with_logits(
            readout(features)[..., 0],
            closed_share(window.phones[known].long()),
            pos_weight=torch.tensor(POSITIVE_WEIGHT),
        )
        downhill(loss, optimiser, schedule)
        if step % 50 == 49:
            print(f"step {step + 1}: {loss.item():.4f}", flush=True)


def speech_with_phones(arguments) -> tuple[list[bank.Entry], dict[str, float]]:
    """Entries and how often each source is drawn."""
    if arguments.corpus:
        entries = with_phones(bank.of_folders(arguments.corpus, arguments.voices, arguments.seed))
        if all(e.held_out for e in entries):
            raise ValueError("--corpus: expected phones/CLIP.tsv of one training clip or more, got none")
        return entries, lasting(entries)
    entries = bank.load(arguments.data, arguments.cache, arguments.voices)
    left = tuple(arguments.leave_speech)
    speech = (arguments.minutes, left, Teacher.load(), arguments.reader)
    return entries + spoken.load(arguments.data, arguments.cache, *speech), SHARES


def main(line: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--corpus", type=Path, nargs="*", default=[], help="corpus folders")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--run", type=Path, required=True, help="ats.pt of training.systems.freetalk.train")
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--reader", type=Path, help="the --reader of training.systems.freetalk.train")
    parser.add_argument("--leave-speech", nargs="*", default=[])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--voices", type=int, default=7)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args(line)
    seeded(arguments)
    saved = torch.load(arguments.run)
    if saved["encoder_config"] is None:
        expected = "--run: expected a run with an encoder of its own"
        raise ValueError(f"{expected}, got one that listens by the ear, whose lips close by phones")
    encoder = CompactEncoder(CompactConfig(**saved["encoder_config"])).eval()
    encoder.load_state_dict(saved["encoder"])
    entries, shares = speech_with_phones(arguments)
    drawn = (list(shares), list(shares.values()))
    sampler = WindowSampler(entries, *drawn, arguments.seed, AugmentOptions())
    fit(encoder, sampler, arguments.steps, arguments.batch)
    saved["encoder"] = encoder.state_dict()
    torch.save(saved, arguments.run)


if __name__ == "__main__":
    main()
