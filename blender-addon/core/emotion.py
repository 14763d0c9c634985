"""The fifteen emotion categories, mixtures of them, and how both are written down."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from .errors import AnyfaceError

# The order is that of the strengths; a test compares it with the library's own list.
EMOTIONS = (
    "neutral", "happy", "pleased", "calm", "surprised", "sad", "upset", "ashamed", "afraid",
    "angry", "disgusted", "contempt", "suspicious", "ill", "drunk",
)  # fmt: skip
MAX_INTENSITY = 1.5
# Mixtures that have names of their own: each fills the rows of the panel.
MIXTURES = {
    "Bittersweet": "happy:0.6,sad:0.6",
    "Smug": "contempt:0.8,happy:0.4",
    "Nervous": "afraid:0.6,pleased:0.3",
    "Awestruck": "surprised:0.7,afraid:0.3",
    "Delighted": "happy:0.9,surprised:0.5",
    "Furious": "angry:1.1,disgusted:0.3",
    "Disappointed": "sad:0.5,upset:0.5",
    "Embarrassed": "ashamed:0.8,pleased:0.3",
    "Horrified": "afraid:0.9,disgusted:0.5",
    "Jealous": "angry:0.5,sad:0.3,suspicious:0.4",
    "Sceptical": "suspicious:0.7,contempt:0.4",
    "Resigned": "calm:0.6,sad:0.5",
}


@dataclass
class Share:
    """One emotion of a mixture and its weight, 0 to 1.5."""

    emotion: str
    weight: float


def mix(shares: Iterable[Share]) -> list[float]:
    """The strengths `[15]` of several emotions, each a `Share` or an object with its fields.

    Neutral counts as 0 beside any other emotion. A sum stronger than a face can show is scaled
    down to `MAX_INTENSITY`.
    """
    row = [0.0] * len(EMOTIONS)
    for share in shares:
        row[_index(share.emotion)] += min(max(share.weight, 0.0), MAX_INTENSITY)
    if any(row[1:]):
        row[0] = 0.0
    return [value * min(1.0, MAX_INTENSITY / max(sum(row), 1e-9)) for value in row]


def total(shares: Iterable[Share]) -> float:
    """The summed strength of several `Share`s, without neutral."""
    return sum(share.weight for share in shares if share.emotion != EMOTIONS[0])


def write_shares(shares: Iterable[Share]) -> str:
    """Several `Share`s as `parse` reads them; "" for none."""
    return ",".join(f"{share.emotion}:{round(share.weight, 4):g}" for share in shares)


def read_shares(text: str) -> list[Share]:
    """Reads `happy:0.4,surprised:0.3` in order, with any sum. Raises `AnyfaceError`."""
    if not isinstance(text, str):
        raise AnyfaceError("input", f"emotion: expected a text such as happy:0.7, got {text!r:.60}")
    shares = []
    for item in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = item.partition(":")
        try:
            number = float(value) if value else 1.0
        except ValueError:
            raise AnyfaceError(
                "input", f"emotion {name}: expected a number, got {value!r}"
            ) from None
        _index(name)
        shares.append(Share(name, _checked(name, number)))
    return shares


def parse(text: str) -> list[float]:
    """Reads `happy:0.7` or a blend `happy:0.4,surprised:0.3` into strengths `[15]`."""
    row = [0.0] * len(EMOTIONS)
    for share in read_shares(text):
        row[_index(share.emotion)] += share.weight
    if sum(row) > MAX_INTENSITY + 1e-6:
        raise AnyfaceError(
            "input", f"emotion: expected a sum of at most {MAX_INTENSITY}, got {sum(row):g}"
        )
    return row


def _index(name: str) -> int:
    if name not in EMOTIONS:
        known = ", ".join(EMOTIONS)
        raise AnyfaceError("input", f"emotion: expected one of {known}, got {name!r}")
    return EMOTIONS.index(name)


def _checked(name: str, value: float) -> float:
    if not math.isfinite(value) or not 0.0 <= value <= MAX_INTENSITY:
        raise AnyfaceError("input", f"emotion {name}: expected 0 to {MAX_INTENSITY}, got {value:g}")
    return value
