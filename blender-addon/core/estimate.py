"""How large an output gets and how long it takes, before it is made.

The constants come from `cargo xtask addon --bench`: a head of 26,733 vertices with 5 and 50 s of
speech on two cores; they are for a decision, not for a promise.
"""

from dataclasses import dataclass

from .shapes import ARKIT, VISEMES

# Basis keys of a performance within 0.1 mm: for 5 s and for 50 s; longer ones need few more.
_SHORT_KEYS, _LONG_KEYS = 35, 54
# Bytes of a vertex in a key or a cache, and of a keyframe in a .blend.
_VERTEX, _KEYFRAME = 12, 80
# Bytes of a number in a table, and its columns.
_NUMBER, _COLUMNS = 9, 63
# Seconds: to begin with, for a second of speech, for a million vertices in a frame.
_BEGIN_S, _SPEECH_S, _MILLION_S = 0.1, 0.012, 0.02
# More seconds for a million vertices in a frame: to find a basis, for 5 s and for 50 s, and to
# solve for the weights of shapes.
_SHORT_BASIS_S, _LONG_BASIS_S, _SOLVE_S = 0.06, 0.12, 0.06
# Seconds for each vertex: of a mesh never seen, of shapes that are made or solved for.
_NEW_S, _RIG_S = 4e-5, 1.1e-5


@dataclass
class Estimate:
    """`size` in bytes, in the .blend or in a file of its own (`beside`); `seconds` of work."""

    size: int
    seconds: float
    beside: bool


def estimate(
    mode: str,
    frames: int,
    vertices: int,
    seconds: float,
    keys: int,
    visemes: bool,
    known: bool = False,
) -> Estimate:
    """For `seconds` of sound in `frames` on `vertices`; `keys` that exist and are matched.

    `known` says that the mesh was animated before, whose landmarks and weights are kept.
    """
    made = len(ARKIT) + (len(VISEMES) if visemes else 0)
    size = {
        "basis": round(_between(seconds, _SHORT_KEYS, _LONG_KEYS))
        * (vertices * _VERTEX + frames * _KEYFRAME),
        "frames": (frames + 2) * (vertices * _VERTEX + _KEYFRAME),
        "cache": frames * vertices * _VERTEX,
        "keys": keys * frames * _KEYFRAME,
        "arkit": made * vertices * _VERTEX + len(ARKIT) * frames * _KEYFRAME,
        "csv": frames * _COLUMNS * _NUMBER,
    }[mode]
    million_s = _MILLION_S
    if mode == "basis":
        million_s += _between(seconds, _SHORT_BASIS_S, _LONG_BASIS_S)
    elif mode in ("keys", "arkit", "csv"):
        million_s += _SOLVE_S
    work = _BEGIN_S + _SPEECH_S * seconds + million_s * frames * vertices / 1e6
    if mode in ("arkit", "csv"):
        work += _RIG_S * vertices
    if not known:
        work += _NEW_S * vertices
    return Estimate(size, work, mode in ("cache", "csv"))


def _between(seconds: float, short: float, long: float) -> float:
    """From what was measured with 5 s and with 50 s of speech."""
    share = min(max((seconds - 5.0) / 45.0, 0.0), 1.0)
    return short + share * (long - short)


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
    if seconds < 1.5:
        return "1 s"
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
