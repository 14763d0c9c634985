"""Trains the tower that turns text into action units, and measures it.

    python -m training.text.train --text runs/text --seed 0

Writes `tower.pt` and `measured.json` beside the text space. `--folds 5` trains on four fifths of the texts
and measures on the rest; the sizes were chosen in this way. `--info-nce 0` leaves out the alignment with the
units' names. `--clip FOLDER` encodes text with CLIP instead of the text space, as the paper does.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

from training.corpus.conditions import UNITS
from training.run import downhill
from training.text.clip import ClipTower, OnClip
from training.text.held_out import HELD_OUT
from training.text.measure import measured
from training.text.pairs import EMOTIONS, EXPRESSIONS, NOTHING, OPPOSITES, TEMPLATES
from training.text.sentences import Clause, Shown, clauses, listed, tokens
from training.text.space import known_form
from training.text.tower import FULL, OnWords, TextTower
from training.text.words import Words

LETTERS = list("aeiouaeiouenrstldnrstbcdfghjklmnpqrstvwxyzäöüéñøß")
FAR = 0.4
"""A word says nothing about a face if its cosine to every word of the pairs is below this."""
TEMPERATURE = 0.1
NAMES = ("raises the inner brows", "raises the outer brows", "lowers the brows", "raises the upper lids",
         "raises the cheeks", "tightens the lids", "wrinkles the nose", "raises the upper lip",
         "lip corners up", "dimples", "lip corners down", "raises the chin", "stretches the lips",
         "drops the jaw", "sucks the lips in",
         "closes the eyes")  # fmt: skip
"""Text for each of `UNITS`. InfoNCE pulls a description towards the texts of its own units."""


Hearing = OnWords | OnClip
Tower = TextTower | ClipTower


@dataclass
class Pairs:
    """Texts by kind, each with the units that it shows."""

    shown: list[tuple[str, Shown]]
    denied: list[tuple[str, Shown]]
    nothing: list[str]

    @staticmethod
    def all() -> Pairs:
        """All pairs of `training.text.pairs`."""
        opposites = [
            (text, Shown.read(OPPOSITES.get(units, "")))
            for table in (EMOTIONS, EXPRESSIONS)
            for units, texts in table.items()
            for text in map(str.strip, texts.split(","))
        ]
        nothing = [text.strip() for text in NOTHING.split(",")]
        return Pairs(listed(EMOTIONS) + listed(EXPRESSIONS), opposites, nothing)

    def without(self, fold: int, folds: int, seed: int) -> tuple[Pairs, list[tuple[str, Shown]]]:
        """The pairs of all folds but this one, and the pairs of this one to test on."""
        of = np.random.default_rng(seed).integers(0, folds, len(self.shown))
        training = [i for i in range(len(of)) if of[i] != fold]
        test = [self.shown[i] for i in range(len(of)) if of[i] == fold]
        rest = Pairs([self.shown[i] for i in training], [self.denied[i] for i in training], self.nothing)
        return rest, test


class Batches:
    """Draws clauses: one or two texts, some with a meaningless word; a denied one; one that shows nothing."""

    def __init__(self, pairs: Pairs, words: Words, arguments: argparse.Namespace):
        self.pairs, self.arguments = pairs, arguments
        self.random = np.random.default_rng(arguments.seed)
        self.templates = np.random.default_rng([arguments.seed, 1])
        self.far = far_words(pairs, words)
        self.share, self.share_denied = shares(pairs.shown), shares(pairs.denied)

    def draw(self) -> tuple[list[Clause], list[Shown]]:
        """A batch: clauses and the units that they show."""
        drawn = [self._one() for _ in range(self.arguments.batch)]
        return [clause for clause, _ in drawn], [shown for _, shown in drawn]

    def _one(self) -> tuple[Clause, Shown]:
        kind = self.random.random()
        if kind < 0.2:
            return self._nothing(), Shown({}, frozenset())
        if kind < 0.3:
            text, shown = self._pick(self.pairs.denied, self.share_denied)
            return self._within(Clause(denied=heard_words(text), said=f"not {text}")), shown
        text, shown = self._pick(self.pairs.shown, self.share)
        said = Clause(heard_words(text), said=text)
        if kind > 0.85:
            text, more = self._pick(self.pairs.shown, self.share)
            said, shown = beside(said, Clause(heard_words(text), said=text)), shown | more
        if self.random.random() < 0.15:
            said = beside(said, spoken([str(self.random.choice(self.far))]))
        return self._within(said), shown

    def _within(self, clause: Clause) -> Clause:
        """The clause in a template. The template's own words mean nothing."""
        clause.said = TEMPLATES[self.templates.integers(len(TEMPLATES))].format(clause.said)
        return clause

    def _nothing(self) -> Clause:
        kind = self.random.random()
        if kind < 0.05:
            return Clause()
        if kind < 0.2:
            return spoken([self._letters() for _ in range(self.random.integers(1, 4))])
        if kind < 0.6:
            text = str(self.random.choice(self.pairs.nothing))
            return Clause(heard_words(text), said=text)
        return spoken([str(w) for w in self.random.choice(self.far, size=self.random.integers(1, 4))])

    def _letters(self) -> str:
        return "".join(self.random.choice(LETTERS, size=self.random.integers(2, 11)))

    def _pick(self, pairs: list[tuple[str, Shown]], share: np.ndarray) -> tuple[str, Shown]:
        return pairs[min(int(np.searchsorted(share, self.random.random())), len(pairs) - 1)]


def spoken(words: list[str]) -> Clause:
    """A clause of only these words."""
    return Clause(words, said=" ".join(words))


def beside(one: Clause, other: Clause) -> Clause:
    """Joins two clauses into one."""
    return Clause([*one.words, *other.words], said=f"{one.said} {other.said}")


@cache
def heard_words(text: str) -> list[str]:
    """Meaningful words of a text's first clause. Words of templates are never meaningful."""
    return clauses(text)[0].words


def shares(pairs: list[tuple[str, Shown]]) -> np.ndarray:
    """Cumulative chance of each pair. A set of units weighs the square root of its number of texts."""
    kinds = [tuple(sorted(shown.units.items())) for _, shown in pairs]
    share = np.array([kinds.count(kind) for kind in kinds]) ** -0.5
    return np.cumsum(share / share.sum())


def far_words(pairs: Pairs, words: Words) -> np.ndarray:
    """Known words that are far from every word of the pairs and so show nothing. Excludes held-out words."""
    used = sorted({w for text, _ in pairs.shown for c in clauses(text) for w in c.words})
    nearest = (words.vectors @ np.stack([words.of(w) for w in used]).T).max(axis=1)
    kept_back = {known_form(w, words.rows) for text, _ in listed(HELD_OUT) for w in tokens(text)}
    far = (name for name, near in zip(words.rows, nearest, strict=True) if near < FAR)
    return np.array([name for name in far if name not in kept_back])


def targets(shown: list[Shown]) -> torch.Tensor:
    """Targets [N, 3, 16] of the tower's logits: shows, on one side only, strength as a share of `FULL`."""
    target = torch.zeros(len(shown), 3, len(UNITS))
    for row, what in enumerate(shown):
        for unit, strength in what.units.items():
            target[row, 0, unit] = 1.0
            target[row, 1, unit] = float(unit in what.one_sided)
            target[row, 2, unit] = strength / FULL
    return target


def loss_of(
    tower: Tower, hearing: Hearing, said: list[Clause], shown: list[Shown], arguments: argparse.Namespace
) -> torch.Tensor:
    """Cross-entropy of the units, and of side and strength for the units that show, plus InfoNCE with the
    units' names."""
    target = targets(shown)
    features = tower.adapted(hearing.hear(said, arguments.noise))
    logits = tower.head(features).unflatten(-1, (3, len(UNITS)))
    every = F.binary_cross_entropy_with_logits(logits, target, reduction="none")
    active = target[:, 0]
    loss = every[:, 0].mean() + 0.3 * (every[:, 1:] * active[:, None]).sum() / (2 * active.sum())
    weight = arguments.info_nce
    return loss + weight * aligned(tower, hearing, features, active) if weight else loss


def aligned(tower: Tower, hearing: Hearing, features: torch.Tensor, active: torch.Tensor) -> torch.Tensor:
    """InfoNCE: pulls each description towards the names of its own units (§3.3, appendix E)."""
    kinds, of = torch.unique(active, dim=0, return_inverse=True)
    names = [" ".join(NAMES[u] for u in torch.nonzero(kind).flatten().tolist()) for kind in kinds]
    heard = hearing.hear([Clause(heard_words(name), said=name) for name in names])
    named = F.normalize(tower.adapted(heard), dim=-1)
    said = active.any(dim=1)
    near = F.normalize(features, dim=-1) @ named.T / TEMPERATURE
    return F.cross_entropy(near[said], of[said])


def train(pairs: Pairs, words: Words, hearing: Hearing, arguments: argparse.Namespace) -> Tower:
    """Trains a tower. Seeded; AdamW with a learning rate that falls along a cosine."""
    torch.manual_seed(arguments.seed)
    batches = Batches(pairs, words, arguments)
    chosen = batches.random.permutation(len(pairs.shown))[: arguments.hidden]
    near = [Clause(heard_words(pairs.shown[i][0])) for i in chosen]
    tower = hearing.tower(arguments.hidden, near)
    optimiser = torch.optim.AdamW(tower.parameters(), lr=arguments.rate, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, arguments.steps)
    for _ in range(arguments.steps):
        loss = loss_of(tower, hearing, *batches.draw(), arguments)
        downhill(loss, optimiser, schedule)
    return tower.eval()


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--text", type=Path, default=Path("runs/text"), help="folder of the text space; results go there too"
    )
    parser.add_argument("--wordnet", type=Path, help="WordNet's folder, to compare with its synonyms")
    parser.add_argument("--clip", type=Path, help="Hugging Face folder of CLIP, instead of the text space")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--hidden", type=int, default=128)
    parser.add_argument("--rate", type=float, default=1e-2)
    parser.add_argument(
        "--noise", type=float, default=0.06, help="mean deviation of the noise on word places"
    )
    parser.add_argument("--info-nce", type=float, default=0.1)
    parser.add_argument("--folds", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    words, pairs, started = Words.load(arguments.text), Pairs.all(), time.monotonic()
    hearing = OnClip(arguments.clip) if arguments.clip else OnWords(words)
    for fold in range(arguments.folds):
        training, test = pairs.without(fold, arguments.folds, arguments.seed)
        print(
            f"fold {fold}:",
            measured(train(training, words, hearing, arguments), hearing, words, training.shown, test),
        )
    if arguments.folds:
        return
    tower = train(pairs, words, hearing, arguments)
    seconds = round(time.monotonic() - started)
    result = measured(tower, hearing, words, pairs.shown, listed(HELD_OUT), arguments.wordnet)
    result |= {"seconds": seconds}
    torch.save(tower.state_dict(), arguments.text / "tower.pt")
    (arguments.text / "measured.json").write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
