"""How large an output gets and how long it takes, before it is made.

The constants come from a head of 26,719 vertices with 5 and 50 s of speech on two busy cores; they
are for a decision, not for a promise.
"""

from dataclasses import dataclass

from .shapes import ARKIT, VISEMES

# Basis keys of a performance within 0.1 mm: for 5 s and for 50 s; longer ones need few more.
_SHORT_KEYS, _LONG_KEYS = 36, 57
# Bytes of a vertex in a key or a cache, and of a keyframe in a .blend.
_VERTEX, _KEYFRAME = 12, 80
# Bytes of a number in a table, and its columns.
_NUMBER, _COLUMNS = 9, 63
# Seconds: to begin with, for a second of speech, for a million vertices in a frame.
_BEGIN_S, _SPEECH_S, _MILLION_S = 0.3, 0.03, 0.15
# More seconds for a million vertices in a frame: to find a basis, to solve for weights.
_MORE_S = {"basis": 0.12, "keys": 0.2, "arkit": 0.2, "csv": 0.2}
_RIG_S_PER_VERTEX = 5e-5


@dataclass
class Estimate:
    """`size` in bytes, in the .blend or in a file of its own (`beside`); `seconds` of work."""

    size: int
    seconds: float
    beside: bool


def estimate(
    mode: str, frames: int, vertices: int, seconds: float, keys: int, visemes: bool
) -> Estimate:
    """For `seconds` of sound in `frames` on `vertices`; `keys` that exist and are matched."""
    made = len(ARKIT) + (len(VISEMES) if visemes else 0)
    size = {
        "basis": _basis_keys(seconds) * (vertices * _VERTEX + frames * _KEYFRAME),
        "frames": (frames + 2) * (vertices * _VERTEX + _KEYFRAME),
        "cache": frames * vertices * _VERTEX,
        "keys": keys * frames * _KEYFRAME,
        "arkit": made * vertices * _VERTEX + len(ARKIT) * frames * _KEYFRAME,
        "csv": frames * _COLUMNS * _NUMBER,
    }[mode]
    million_s = _MILLION_S + _MORE_S.get(mode, 0.0)
    work = _BEGIN_S + _SPEECH_S * seconds + million_s * frames * vertices / 1e6
    if mode in ("arkit", "csv"):
        work += _RIG_S_PER_VERTEX * vertices
    return Estimate(size, work, mode in ("cache", "csv"))


def _basis_keys(seconds: float) -> int:
    share = min(max((seconds - 5.0) / 45.0, 0.0), 1.0)
    return round(_SHORT_KEYS + share * (_LONG_KEYS - _SHORT_KEYS))


def in_words(found: Estimate, frames: int) -> str:
    """ "120 frames, about 14 MB in the .blend, 2 s"."""
    where = "in a file" if found.beside else "in the .blend"
    return f"{frames} frames, about {_bytes(found.size)} {where}, {_seconds(found.seconds)}"


def _bytes(size: int) -> str:
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.0f} {unit}"
        size /= 1000
    return f"{size:.1f} GB"


def _seconds(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
