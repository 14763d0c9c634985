"""Drawn mouths by name: which drawing shows each mouth of a chart, and when drawings change."""

import re

from .errors import AnyfaceError

RHUBARB, PRESTON_BLAIR = "rhubarb", "preston-blair"
# The mouths of each chart, as the library draws them, the closed ones first and the one at rest
# last. Each has a list of names that its drawings may have.
MOUTHS: dict[str, dict[str, tuple[str, ...]]] = {
    RHUBARB: {
        "A": ("a", "mbp", "pbm", "bmp", "mpb", "closed"),
        "B": ("b", "etc", "cdgknrsthyz", "consonants", "clenched"),
        "C": ("c", "e", "eh"),
        "D": ("d", "ai", "aei", "aa", "wide"),
        "E": ("e", "o", "oh", "rounded"),
        "F": ("f", "u", "oo", "wq", "w", "pucker", "puckered"),
        "G": ("g", "fv", "f"),
        "H": ("h", "l", "th", "tongue"),
        "X": ("x", "rest", "idle", "neutral", "basis"),
    },
    PRESTON_BLAIR: {
        "MBP": ("mbp", "pbm", "bmp", "mpb", "m", "closed"),
        "etc": ("etc", "cdgknrsthyz", "cdgknrsyz", "consonants", "other"),
        "E": ("e", "ee", "eh"),
        "AI": ("ai", "a", "aei", "aa", "ah"),
        "O": ("o", "oh"),
        "U": ("u", "oo", "ou"),
        "WQ": ("wq", "qw", "w", "woo"),
        "FV": ("fv", "f", "v"),
        "L": ("l", "lth", "th", "tongue"),
        "rest": ("rest", "x", "idle", "neutral", "basis"),
    },
}
# The drawing that stands in for a missing one. A to F have to be there, as in Rhubarb itself.
STAND_INS = {
    RHUBARB: {"G": "B", "H": "C", "X": "A"},
    PRESTON_BLAIR: {"etc": "E", "WQ": "U", "FV": "MBP", "L": "E", "rest": "MBP"},
}
# Words that surround the name of a mouth in the name of a drawing.
_WORDS = {"mouth", "mouths", "lip", "lips", "viseme", "vis", "phoneme", "shape", "key", "rhubarb"}


def rest(kind: str) -> str:
    """The mouth at rest."""
    return next(reversed(MOUTHS[kind]))


def guess(kind: str, names: list[str]) -> dict[str, str]:
    """Guesses from `names` of drawings which one shows each mouth; leaves out mouths without one.

    A name of one letter means that letter of the chart if most letters of the chart are there.
    Then "e" is Rhubarb's E, but in a set of vowels it is the wide mouth.
    """
    read: dict[str, str] = {}
    for name in names:
        read.setdefault(_plain(name), name)
    objects: dict[str, str] = {}
    spelled = [mouth.lower() for mouth in MOUTHS[kind] if mouth.lower() in read]
    for mouth, spellings in MOUTHS[kind].items():
        spelling, *others = dict.fromkeys((mouth.lower(), *spellings))
        # If most letters of the chart are there, each of them names its own mouth only.
        if len(spelled) > len(MOUTHS[kind]) // 2:
            others = [text for text in others if text not in spelled and len(text) > 1]
        elif kind == RHUBARB:
            spelling, others = (others[0], others[1:]) if len(spelling) == 1 else (spelling, others)
        hit = next((text for text in (spelling, *others) if text in read), None)
        if hit is not None and read[hit] not in objects.values():
            objects[mouth] = read[hit]
    return objects


def _plain(name: str) -> str:
    """The mouth that a drawing's name stands for: "Mouth_A.001" is a, "lips M B P" is mbp."""
    name = re.sub(r"\.\d{3,}$", "", name)
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    parts = [part.lower() for part in re.split(r"[^A-Za-z]+", name) if part]
    return "".join(part for part in parts if part not in _WORDS)


def complete(kind: str, drawings: dict[str, object], where: str) -> dict[str, object]:
    """The drawing that shows each mouth, stand-ins included.

    `drawings` are the existing drawings by mouth; `where` says in words where we looked.
    Raises `AnyfaceError("input")` if a mouth has neither a drawing nor a stand-in.
    """
    shown, missing = {}, []
    for mouth in MOUTHS[kind]:
        drawing = drawings.get(mouth, drawings.get(STAND_INS[kind].get(mouth, "")))
        if drawing is not None:
            shown[mouth] = drawing
        elif mouth not in STAND_INS[kind] or STAND_INS[kind][mouth] not in missing:
            missing.append(mouth)
    if missing:
        every = ", ".join(missing)
        text = f"no drawing of {every} in {where}: name one for each, or choose it in the list"
        raise AnyfaceError("input", text)
    return shown


def changes(
    kind: str, chart: list[tuple[float, float, str]], start_frame: float, fps: float, earliest: int
) -> list[tuple[int, str]]:
    """The scene frames at which the mouth changes, in rising order, each with the new mouth.

    `chart` holds start and end in seconds of each mouth, with its name. Its sound begins at the
    frame `start_frame`, and `fps` is the scene's. The mouth rests after the chart. It also rests
    in the frame before the chart, unless that frame lies before `earliest`.
    """
    if not chart:
        return []
    begin, resting = round(start_frame + chart[0][0] * fps), rest(kind)
    at = {begin - 1: resting} if begin - 1 >= earliest else {}
    at |= {round(start_frame + start_s * fps): mouth for start_s, _, mouth in chart}
    at[round(start_frame + chart[-1][1] * fps)] = resting
    starts: list[tuple[int, str]] = []
    for frame, mouth in sorted(at.items()):
        if not starts or starts[-1][1] != mouth:
            starts.append((frame, mouth))
    return starts
