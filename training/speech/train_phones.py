"""Trains the phone recogniser, which also aligns texts, on the ear.

    python -m training.speech.train_phones --data ../shared/data --out runs/phones

First the read-out learns from speech whose phones have known times: Dutch, German actors, twenty languages by
espeak-ng. Then English and German recordings with text are added: espeak-ng gives the phones of their texts
and the read-out gives the times. The model's table of letters holds the rules of `training.speech.letters`.
`training.speech.evaluate_phones` measures the result.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from training.corpus.espeak import Espeak
from training.corpus.heard import Heard, load
from training.corpus.phones import SEGMENTS, segments
from training.nn.checkpoint import write_model
from training.run import downhill, seeded
from training.speech.ear import Ear
from training.speech.letters import NEVER as LETTERS_NEVER
from training.speech.letters import PHONES, UNITS, best_path, table_of_phones, table_of_rules
from training.speech.phones import CLASSES, PARTS, PhoneConfig, PhoneReadout, class_of_segment

FRAMES = 64
FEATURE_NOISE = 0.1
SHARES = {"nathalie_nl": 0.2, "emodb_de": 0.1, "kathleen_en": 0.25, "kerstin_de": 0.15, "kokoro": 0.15}
"""Share of each batch for these sources, if they are at hand. espeak-ng gets the rest."""
NEVER = ("grid_s1", "librivox_en")
TEXTS = {"kathleen_en": "en-us", "kerstin_de": "de"}
PRIOR_POWER = 0.8


class Sampler:
    """Draws random stretches of speech with their classes."""

    def __init__(self, heard: list[Heard], seed: int):
        self.random = np.random.default_rng(seed)
        self.by_source: dict[str, list[Heard]] = {}
        for h in heard:
            family = h.source.split("_")[0]
            source = family if family in ("espeak", "kokoro") else h.source
            self.by_source.setdefault(source, []).append(h)
        self.classes = class_of_segment()
        known = {s: SHARES[s] for s in self.by_source if s in SHARES}
        self.sources = [*known, "espeak"]
        self.shares = [*known.values(), 1.0 - sum(known.values())]

    def batch(self, size: int) -> tuple[Tensor, Tensor]:
        """Features [B, T, C] and classes [B, 4 T], −1 after the end of a short utterance."""
        rows = [self._one() for _ in range(size)]
        return torch.stack([f for f, _ in rows]), torch.stack([c for _, c in rows])

    def _one(self) -> tuple[Tensor, Tensor]:
        chosen = self.by_source[self.random.choice(self.sources, p=self.shares)]
        heard = chosen[self.random.integers(len(chosen))]
        features = heard.features[self.random.integers(len(heard.features))].float()
        classes = rows_of(self.classes[heard.phones.long()])
        first = int(self.random.integers(max(1, len(features) - FRAMES + 1)))
        features = features[first : first + FRAMES]
        classes = classes[PARTS * first : PARTS * (first + FRAMES)]
        short = FRAMES - len(features)
        return F.pad(features, (0, 0, 0, short)), F.pad(classes, (0, PARTS * short), value=-1)


def rows_of(phones: Tensor) -> Tensor:
    """Turns a track at mel rate [4 T] into rows of posteriors, which stand two mel frames earlier."""
    half = PARTS // 2
    return torch.cat([phones[:1].expand(half), phones])[: len(phones)]


def fit(model: PhoneReadout, heard: list[Heard], steps: int, batch: int, seed: int) -> None:
    """Trains the read-out; `log_prior` becomes the logarithm of the share of each class."""
    sampler, counts = Sampler(heard, seed), torch.ones(len(CLASSES))
    optimiser = torch.optim.AdamW(model.parameters(), 3e-3, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 3e-3, steps + 1, pct_start=0.1)
    for step in range(steps):
        features, classes = sampler.batch(batch)
        features = features + FEATURE_NOISE * torch.randn_like(features)
        log_p = model(features)
        loss = F.nll_loss(log_p.flatten(0, 1), classes.flatten(), ignore_index=-1)
        downhill(loss, optimiser, schedule)
        counts += torch.bincount(classes[classes >= 0], minlength=len(CLASSES))
        if step % 200 == 199:
            print(f"step {step + 1}: {loss.item():.3f}", flush=True)
    model.log_prior.copy_((counts / counts.sum()).log())


@torch.no_grad()
def log_likelihood(model: PhoneReadout, features: Tensor) -> np.ndarray:
    """log p(k | x) − 0.8 log p(k), [4 T, K], of features [T, C]."""
    log_p = model(features.float()[None])[0]
    return (log_p - PRIOR_POWER * model.log_prior).double().numpy()


def read_texts(model: PhoneReadout, heard: list[Heard]) -> list[Heard]:
    """Gives recordings with text but no phones those of espeak-ng, at the times at which they are heard."""
    espeak, classes, labelled = Espeak(), class_of_segment(), []
    representative = torch.tensor([SEGMENTS.index(kinds[0]) for kinds in CLASSES.values()])
    for h in heard:
        _, phones = espeak.speak(h.text, TEXTS[h.source])
        said = [SEGMENTS.index(s) for p in phones for s in segments(p.label)]
        said = torch.unique_consecutive(classes[torch.tensor(said)])
        said = said[said != 0].numpy()
        # A pause may stand between any two phones.
        chain = np.zeros(2 * len(said) + 1, int)
        chain[1::2] = said
        skip = np.where(np.arange(len(chain)) % 2 == 0, 0.0, LETTERS_NEVER)
        skip[2:-2:2] = 8.0
        path = best_path(log_likelihood(model, h.features[len(h.features) // 2])[:, chain], skip)
        track = representative[torch.from_numpy(chain[path])]
        # Rows of posteriors stand two mel frames earlier than the track.
        h.phones = torch.cat([track[PARTS // 2 :], track[-1:].expand(PARTS // 2)])
        labelled.append(h)
    return labelled


def train(arguments) -> Path:
    """Runs the training and returns the model's folder."""
    seeded(arguments)
    ear = Ear()
    every = load(arguments.data, arguments.cache, ear, arguments.minutes)
    heard = [h for h in every if not h.held_out and h.source not in NEVER]
    timed, texts = ([h for h in heard if (h.phones is None) == untimed] for untimed in (False, True))
    model = PhoneReadout(PhoneConfig(channels=ear.body.config.channels, hidden=arguments.hidden))
    fit(model, timed, arguments.steps // 2, arguments.batch, arguments.seed)
    timed += read_texts(model, texts)
    fit(model, timed, arguments.steps, arguments.batch, arguments.seed + 1)
    table = np.concatenate([table_of_rules(), table_of_phones()])
    state = model.state_dict() | {"table": torch.from_numpy(table).float()}
    config = model.config.to_json() | {"units": [*UNITS, *PHONES]}
    return write_model(arguments.out, state, config)


def parser() -> argparse.ArgumentParser:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, default=Path("runs/phones"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--minutes", type=float, default=3.0, help="minutes of each language by espeak-ng")
    parser.add_argument("--hidden", type=int, default=160)
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    return parser


if __name__ == "__main__":
    print(train(parser().parse_args()))
