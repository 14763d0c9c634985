"""Estimates how large an output gets and how long it takes, before it is made.

The constants come from `cargo xtask addon --bench`: a head of 26,733 vertices with 5 and 50 s of
speech on two cores. They help an artist decide and promise nothing.
"""

from dataclasses import dataclass

# Bytes of a vertex in a key or a cache, and of a keyframe in a .blend.
VERTEX, KEYFRAME = 12, 80
# Seconds to solve for the weights of shapes, for a million vertices in a frame, and seconds to make
# shapes, for each vertex.
SOLVE_S, RIG_S = 0.06, 1.1e-5
# Seconds to start, for each second of speech, for a million vertices in a frame, and for each
# vertex of a mesh that was never animated before.
_BEGIN_S, _SPEECH_S, _MILLION_S, _NEW_S = 0.1, 0.012, 0.02, 4e-5


@dataclass
class Asked:
    """What is to be animated: `seconds` of sound in `frames` on `vertices`.

    `keys` is how many existing keys are matched; `visemes` are made as well.
    """

    frames: int
    vertices: int
    seconds: float
    keys: int = 0
    visemes: bool = False


@dataclass
class Cost:
    """What an output adds: `size` in bytes, in the .blend or in a file of its own (`beside`).

    `million_s` are seconds for a million vertices in a frame, `vertex_s` for each vertex.
    """

    size: int
    million_s: float = 0.0
    vertex_s: float = 0.0
    beside: bool = False


def seconds_of(cost: Cost, job: Asked, known: bool) -> float:
    """How long all the work takes.

    `known` says that the mesh was animated before, so that its landmarks and weights are kept.
    """
    million = job.frames * job.vertices / 1e6
    work = _BEGIN_S + _SPEECH_S * job.seconds + (_MILLION_S + cost.million_s) * million
    return work + (cost.vertex_s + (0.0 if known else _NEW_S)) * job.vertices


def between(seconds: float, short: float, long: float) -> float:
    """Interpolates between a value measured with 5 s of speech and one measured with 50 s."""
    share = min(max((seconds - 5.0) / 45.0, 0.0), 1.0)
    return short + share * (long - short)


def in_words(cost: Cost, job: Asked, known: bool) -> str:
    """ "120 frames, about 14 MB in the .blend, 2 s"."""
    where = "in a file" if cost.beside else "in the .blend"
    seconds = _seconds(seconds_of(cost, job, known))
    return f"{job.frames} frames, about {_bytes(cost.size)} {where}, {seconds}"


def _bytes(size: float) -> str:
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.0f} {unit}"
        size /= 1000
    return f"{size:.1f} GB"


def _seconds(seconds: float) -> str:
    if seconds < 1.5:
        return "1 s"
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
