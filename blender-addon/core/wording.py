"""Numbers in words for somebody who looks at a face."""

# About what a human head measures from chin to crown.
HEAD_MM = 230.0
# Above each share its words.
_SHARES = ((0.9, "nearly all"), (0.75, "most"), (0.6, "about two thirds"), (0.4, "about half"))


def share(part: float) -> str:
    """How much of a performance can be seen: 0.66 is "about two thirds of the motion (66 %)"."""
    words = next((words for least, words in _SHARES if part >= least), "less than half")
    return f"{words} of the motion ({part:.0%})".replace("%)", " %)")


def listed(names: list[str]) -> str:
    """ "jaw", "brows and jaw", "eyes, brows and jaw"."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def length(mm: float, is_human: bool, digits: int = 1) -> str:
    """How far something is, given in millimetres on a head of human size, for an artist whose head
    has that size or another one."""
    if is_human:
        return f"{mm:.{digits}f} mm"
    return f"{100.0 * mm / HEAD_MM:.2g} % of the head's height"
