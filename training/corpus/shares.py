"""The sources of a training run, corpus folders or the project's own, and how often each is drawn."""

from training.corpus.bank import Entry
from training.losses import SCALE_M, lip_scale


def lasting(entries: list[Entry]) -> dict[str, float]:
    """Shares of the sources, proportional to the length of their training clips. They sum to 1."""
    frames: dict[str, int] = {}
    for entry in entries:
        if not entry.held_out:
            frames[entry.source] = frames.get(entry.source, 0) + len(entry.motion)
    if not frames:
        raise ValueError("expected training clips, got none: split of every row is val or test")
    return {source: frames[source] / sum(frames.values()) for source in sorted(frames)}


def measured_scales(sources: list[str], entries: list[Entry]) -> dict[str, float]:
    """Typical lip motion of each source, metres. It is measured for sources that are not ours."""
    scales = dict(SCALE_M)
    for source in set(sources) - set(SCALE_M):
        scales[source] = lip_scale([e.motion for e in entries if e.source == source and not e.held_out])
    return scales


def with_phones(entries: list[Entry]) -> list[Entry]:
    """Entries whose phones are known from end to end."""
    return [e for e in entries if len(e.phones) > len(e.motion) and bool((e.phones >= 0).all())]
