"""The emotion that the library hears in a voice over time."""

import json
from dataclasses import asdict, dataclass, fields

import numpy as np

# Artists do not see emotions whose probability stays below this.
LIKELY = 0.25
# The number of instants that are kept with a take; a picture cannot show more.
_MOST = 200


@dataclass(frozen=True)
class HeardEmotion:
    """How likely each emotion is at `time_s` `[N]`, seconds: its `probability` `[N]` by name.

    `intensity` `[N]`, 0 to 1, is how strongly the face shows it. `valence` and `arousal` `[N]`,
    -1 to 1, are derived from the probabilities, not measured on their own.
    """

    time_s: list[float]
    probability: dict[str, list[float]]
    intensity: list[float]
    valence: list[float]
    arousal: list[float]

    @classmethod
    def of_json(cls, text: bytes | str | None) -> "HeardEmotion | None":
        """Reads the library's JSON; None if there is none or it holds no instant."""
        return cls.of_plain(json.loads(text)) if text else None

    @classmethod
    def of_plain(cls, values: dict) -> "HeardEmotion | None":
        """Reads the values of `to_plain`; None for any others, such as an earlier version's."""
        try:
            names = list(values["probability"])
            rows = [values[name] for name in ("time_s", "intensity", "valence", "arousal")]
            rows += [values["probability"][name] for name in names]
            numbers = np.array(rows, dtype=np.float64)
        except (AttributeError, KeyError, TypeError, ValueError):
            return None
        if numbers.ndim != 2 or numbers.shape[1] == 0 or not np.isfinite(numbers).all():
            return None
        times, intensity, valence, arousal, *shares = numbers.tolist()
        return cls(times, dict(zip(names, shares, strict=True)), intensity, valence, arousal)

    def to_plain(self) -> dict:
        """Returns plain values; a long sound is thinned to evenly spaced instants."""
        count = len(self.time_s)
        at = np.linspace(0, count - 1, min(count, _MOST)).round().astype(int)
        thinned = lambda row: [round(float(row[k]), 3) for k in at]  # noqa: E731
        plain = asdict(self)
        plain["probability"] = {name: thinned(row) for name, row in self.probability.items()}
        return plain | {
            item.name: thinned(plain[item.name])
            for item in fields(self)
            if item.name != "probability"
        }

    def likely(self) -> list[tuple[str, float, float]]:
        """The emotions that are likely at any time, the likeliest first.

        Each comes with its largest probability and the time of that in seconds.
        """
        names = []
        for name, row in self.probability.items():
            at = int(np.argmax(row))
            if row[at] >= LIKELY:
                names.append((name, float(row[at]), float(self.time_s[at])))
        return sorted(names, key=lambda of: -of[1])
