"""Fits the layer of an ear for emotion to rows, and measures it on corpora, actors and readers left out.

A logistic regression. Every row is moved to the neutral voice of another speaker, so that neither a voice nor
a room is taken for an emotion.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from training.corpus import crema_d, emodb
from training.speech.emotion_ear import LARGEST, EmotionLayer
from training.speech.emotion_rows import MANY_SPEAKERS, Rows
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS

VOTED_SHARE = 0.3
"""Share of the votes in the label of a clip. The actor's intention has the rest."""
NEUTRAL_VOTES = 0.4
"""A clip acted as neutral counts as the actor's neutral voice from this share of the votes on."""
SHARES = {crema_d.SOURCE: 0.45, emodb.SOURCE: 0.2}
"""How often rows of a corpus are drawn, each emotion as often as the others. All readers have the rest."""
TOWARDS_MEAN = 0.7
"""A clip of `MANY_SPEAKERS` is not yet a voice, so it is moved towards the mean of its source."""
STEPS, BATCH, RATE, DECAY = 400, 1024, 0.01, 0.01
DOUBT, ALLOWED = 0.7, 0.05
"""Probability of any emotion from which people see it (a fifth of its strength, by the rule of
rust-core/src/speech/shown_emotion.rs), and the share of neutral readings of unknown corpora that may reach
it. The bias of neutral is moved so far."""
SIX = 6
"""The first of `HEARD_EMOTIONS`, which the actors of both corpora acted."""
BIAS_STEPS = 60
GRID = {"grid_s1", "grid_five"}


@dataclass
class Voices:
    """Mean neutral rows of speakers: `mean` [V, R], how often each is drawn [V], and the place of each row's
    own speaker [N], −1 for a row that cannot be moved."""

    mean: Tensor
    chance: Tensor
    of_row: Tensor


def neutral_voices(rows: Rows, z: Tensor, use: np.ndarray) -> Voices:
    """Neutral voices among the rows `use`, of rows `z` [N, R] that are scaled."""
    heard = rows.votes[:, 0].numpy()
    neutral = use & (rows.label == 0) & ((rows.source != crema_d.SOURCE) | (heard >= NEUTRAL_VOTES))
    many = rows.source == MANY_SPEAKERS
    names = sorted(set(rows.speaker[neutral & ~many]))
    places = {name: place for place, name in enumerate(names)}
    means = [z[torch.from_numpy(neutral & (rows.speaker == name))].mean(0) for name in names]
    sources = [name.split(" ")[0] for name in names]
    strangers = torch.from_numpy(neutral & many)
    if strangers.any():
        middle = z[strangers].mean(0)
        means += list(middle + TOWARDS_MEAN * (z[strangers] - middle))
        sources += [MANY_SPEAKERS] * int(strangers.sum())
    counts = {source: sources.count(source) for source in set(sources)}
    chance = torch.tensor([counts[source] ** -0.5 for source in sources])
    of_row = torch.tensor([places.get(name, -1) for name in rows.speaker])
    return Voices(torch.stack(means), chance, of_row)


def drawn_shares(rows: Rows, use: np.ndarray) -> Tensor:
    """How often each row is drawn, [N]."""
    share, sources = np.zeros(len(rows)), sorted(set(rows.source[use]))
    readers = [source for source in sources if source not in SHARES]
    for source in sources:
        of_source = use & (rows.source == source)
        if source not in SHARES:
            share[of_source] = (1.0 - sum(SHARES.values())) / len(readers) / of_source.sum()
            continue
        labels = sorted(set(rows.label[of_source]))
        for label in labels:
            chosen = of_source & (rows.label == label)
            share[chosen] = SHARES[source] / len(labels) / chosen.sum()
    return torch.from_numpy(share)


def fitted(rows: Rows, use: np.ndarray, seed: int = 0) -> EmotionLayer:
    """The layer of the rows `use`, a mask [N]."""
    random = torch.Generator().manual_seed(seed)
    chosen = rows.x[torch.from_numpy(use)]
    mean, scale = chosen.mean(0), chosen.std(0) + 1e-4
    z = ((rows.x - mean) / scale).clamp(-LARGEST, LARGEST)
    voices, shares = neutral_voices(rows, z, use), drawn_shares(rows, use)
    acted = torch.nn.functional.one_hot(torch.from_numpy(rows.label), len(HEARD_EMOTIONS)).float()
    has_votes = rows.votes.sum(1, keepdim=True) > 0
    target = torch.where(has_votes, VOTED_SHARE * rows.votes + (1.0 - VOTED_SHARE) * acted, acted)
    # crema_d has no boredom: its rows say nothing about calm.
    unknown = torch.zeros(len(rows), len(HEARD_EMOTIONS), dtype=torch.bool)
    unknown[torch.from_numpy(rows.source == crema_d.SOURCE), HEARD_EMOTIONS.index("calm")] = True
    weight = torch.zeros(z.shape[1], len(HEARD_EMOTIONS), requires_grad=True)
    bias = torch.zeros(len(HEARD_EMOTIONS), requires_grad=True)
    optimiser = torch.optim.Adam([weight, bias], lr=RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, STEPS)
    for _ in range(STEPS):
        row = torch.multinomial(shares, BATCH, replacement=True, generator=random)
        own = voices.of_row[row]
        other = torch.multinomial(voices.chance, BATCH, replacement=True, generator=random)
        shift = voices.mean[other] - voices.mean[own.clamp_min(0)]
        moved = z[row] + (own >= 0)[:, None] * shift
        logits = (moved @ weight + bias).masked_fill(unknown[row], -1e4)
        loss = -(target[row] * logits.log_softmax(1)).sum(1).mean() + DECAY * weight.square().sum()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    readers = voices.mean.mean(0) * scale + mean
    arrays = (mean, scale, weight.detach(), bias.detach(), readers)
    return EmotionLayer(*(array.double().numpy() for array in arrays))


def groups(rows: Rows) -> list[set[str]]:
    """Corpora of readers that are left out together: those of one room.

    Half of `MANY_SPEAKERS` are pauses and noise, which count little in a whole sound.
    """
    readers = sorted(set(rows.source) - set(SHARES) - {MANY_SPEAKERS})
    together = [GRID & set(readers), *({source} for source in readers if source not in GRID)]
    return [group for group in together if group]


def doubts_of_readers(rows: Rows, use: np.ndarray) -> np.ndarray:
    """Log-odds of any emotion against neutral on neutral readings, each corpus left out in turn, [M]."""
    odds = []
    for group in groups(rows):
        inside = np.isin(rows.source, list(group))
        judged = inside & (rows.copy == 0)
        odds.append(odds_of(fitted(rows, use & ~inside), rows.x[torch.from_numpy(judged)]))
    return np.concatenate(odds)


def odds_of(layer: EmotionLayer, x: Tensor) -> np.ndarray:
    """Log-odds of any emotion against neutral, [N]."""
    logits = torch.from_numpy(layer.logits(x.double().numpy()))
    return (logits[:, 1:].logsumexp(1) - logits[:, 0]).numpy()


def calibrated(layer: EmotionLayer, doubts: np.ndarray) -> EmotionLayer:
    """The layer whose probability of any emotion exceeds `DOUBT` on at most `ALLOWED` of the readings."""
    wanted = np.log(DOUBT / (1.0 - DOUBT))
    bias = layer.bias.copy()
    bias[0] += np.quantile(doubts, 1.0 - ALLOWED) - wanted
    return EmotionLayer(layer.mean, layer.scale, layer.weight, bias, layer.readers)


def expecting(layer: EmotionLayer, rows: Rows, known: np.ndarray, by_vote: bool) -> EmotionLayer:
    """The layer for sounds of which each emotion is as frequent as the others, or as frequent as in the votes
    on the acted rows `known` [N]. The fit itself sees far more neutral voices than either.
    """
    known = known & (rows.copy == 0) & np.isin(rows.source, list(SHARES)) & (rows.label < SIX)
    logits = layer.logits(rows.x[torch.from_numpy(known)].double().numpy())[:, :SIX]
    label = rows.label[known]
    weight, wanted = 1.0 / np.bincount(label, minlength=SIX)[label], np.full(SIX, 1.0 / SIX)
    if by_vote:
        weight, wanted = np.ones(len(label)), rows.votes[torch.from_numpy(known)].numpy()[:, :SIX].mean(0)
    weight, bias = weight / weight.sum(), np.zeros(SIX)
    for _ in range(BIAS_STEPS):
        powers = np.exp(logits + bias)
        bias += 0.5 * np.log(wanted / (weight @ (powers / powers.sum(axis=1, keepdims=True))))
    moved = layer.bias.copy()
    moved[:SIX] += bias
    return EmotionLayer(layer.mean, layer.scale, layer.weight, moved, layer.readers)


def right(layer: EmotionLayer, rows: Rows, judged: np.ndarray, classes: list[int], by_vote: bool) -> float:
    """Share of rows that are named as acted (mean over classes) or as most listeners heard them."""
    judged = judged & (rows.copy == 0)
    logits = layer.logits(rows.x[torch.from_numpy(judged)].double().numpy())[:, classes]
    named = np.array(classes)[logits.argmax(1)]
    if by_vote:
        votes = rows.votes[torch.from_numpy(judged)].numpy()[:, classes]
        order = np.sort(votes, axis=1)
        agreed = order[:, -1] > order[:, -2]
        return float((named == np.array(classes)[votes.argmax(1)])[agreed].mean())
    label = rows.label[judged]
    return float(np.mean([(named[label == c] == c).mean() for c in classes if (label == c).any()]))


def measure(rows: Rows) -> Iterator[str]:
    """Left-out actors, corpora and readers, one line each."""
    is_crema, is_emodb = rows.source == crema_d.SOURCE, rows.source == emodb.SOURCE
    every, six, five = np.ones(len(rows), bool), list(range(SIX)), list(range(5))
    actors = sorted(set(rows.speaker[is_crema]))
    scores = {"acted": [], "vote": []}
    for fold in range(5):
        left = np.isin(rows.speaker, actors[fold::5])
        layer = fitted(rows, ~left)
        for name, of in scores.items():
            by_vote = name == "vote"
            expected = expecting(layer, rows, ~left & is_crema if by_vote else ~left, by_vote)
            of.append(right(expected, rows, left & is_crema, six, by_vote))
    acted, vote = mean_of(scores["acted"]), mean_of(scores["vote"])
    yield f"crema_d, actors left out, six classes: {acted} as acted, {vote} by vote"
    seven = []
    for actor in sorted(set(rows.speaker[is_emodb])):
        left = rows.speaker == actor
        judged = left & (rows.copy == 0)
        logits = fitted(rows, ~left).logits(rows.x[torch.from_numpy(judged)].double().numpy())
        seven += list(logits.argmax(1) == rows.label[judged])
    yield f"emodb_de, an actor left out, seven classes: {mean_of(seven)}"
    for name, corpus in (("emodb_de", is_emodb), ("crema_d", is_crema)):
        layer = fitted(rows, every & ~corpus)
        expected = expecting(layer, rows, ~corpus, False)
        for what, judged in (("", rows), (", neutral known", beside_neutral(rows, corpus, layer))):
            shares = [right(expected, judged, corpus, classes, False) for classes in (five, six)]
            yield f"{name} left out whole{what}: five classes {shares[0]:.3f}, six {shares[1]:.3f}"
        yield from shown_of_corpus(rows, corpus, layer, doubts_of_readers(rows, ~corpus))


def mean_of(values: list) -> str:
    """Mean of scores, in three digits."""
    return f"{float(np.mean(values)):.3f}"


def beside_neutral(rows: Rows, corpus: np.ndarray, layer: EmotionLayer) -> Rows:
    """Rows of a corpus moved from each speaker's neutral voice to that of the readers."""
    x = rows.x.clone()
    for name in sorted(set(rows.speaker[corpus])):
        own = torch.from_numpy(corpus & (rows.speaker == name))
        neutral = own & torch.from_numpy((rows.label == 0) & (rows.copy == 0))
        if neutral.any():
            x[own] += torch.from_numpy(layer.readers).float() - x[neutral].mean(0)
    return Rows(x, rows.source, rows.speaker, rows.label, rows.votes, rows.copy, rows.held_out)


def shown_of_corpus(rows: Rows, corpus: np.ndarray, layer: EmotionLayer, doubts: np.ndarray) -> Iterator[str]:
    """How often acted clips of a corpus that was left out show, where 1 and 5 % of unknown readings do."""
    judged = corpus & (rows.copy == 0) & (rows.label < 6)
    x, label = rows.x[torch.from_numpy(judged)], rows.label[judged]
    odds, named = odds_of(layer, x), 1 + layer.logits(x.double().numpy())[:, 1:6].argmax(1)
    for allowed in (0.01, ALLOWED):
        above, acted = odds > np.quantile(doubts, 1.0 - allowed), label > 0
        shares = [above[acted].mean(), (named == label)[above & acted].mean(), above[~acted].mean()]
        yield (
            f"  where {100 * allowed:.0f} % of unknown readings show: acted {shares[0]:.2f}, "
            f"of them as acted {shares[1]:.2f}; acted as neutral {shares[2]:.2f}"
        )
