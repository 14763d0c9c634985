"""The fifteen emotion categories and how they are written down."""

import math

from .errors import AnyfaceError

# The order is that of the strengths; a test compares it with the library's own list.
EMOTIONS = (
    "neutral", "happy", "pleased", "calm", "surprised", "sad", "upset", "ashamed", "afraid",
    "angry", "disgusted", "contempt", "suspicious", "ill", "drunk",
)  # fmt: skip
MAX_INTENSITY = 1.5


def strengths(name: str, intensity: float) -> list[float]:
    """The strength of each category, `[15]`, for one emotion at `intensity` (0 to 1.5)."""
    row = [0.0] * len(EMOTIONS)
    row[_index(name)] = _checked(name, intensity)
    return row


def parse(text: str) -> list[float]:
    """Reads `happy:0.7` or a blend `happy:0.4,surprised:0.3` into strengths `[15]`."""
    row = [0.0] * len(EMOTIONS)
    for item in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = item.partition(":")
        try:
            number = float(value) if value else 1.0
        except ValueError:
            raise AnyfaceError(
                "input", f"emotion {name}: expected a number, got {value!r}"
            ) from None
        row[_index(name)] += _checked(name, number)
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
