"""Puts numbers into words that an artist understands."""

# The height of a human head from chin to crown, approximately.
HEAD_MM = 230.0
# The words for each share and above.
_SHARES = ((0.9, "nearly all"), (0.75, "most"), (0.6, "about two thirds"), (0.4, "about half"))


def share(part: float) -> str:
    """How much of the motion is shown: 0.66 gives "about two thirds of the motion (66 %)"."""
    words = next((words for least, words in _SHARES if part >= least), "less than half")
    return f"{words} of the motion ({part:.0%})".replace("%)", " %)")


def listed(names: list[str]) -> str:
    """ "jaw", "brows and jaw", "eyes, brows and jaw"."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def length(mm: float, is_human: bool, digits: int = 1) -> str:
    """A length in words. `mm` is its length on a head of human size.

    An artist whose head has another size reads it as a share of the head's height.
    """
    if is_human:
        return f"{mm:.{digits}f} mm"
    return f"{100.0 * mm / HEAD_MM:.2g} % of the head's height"
