"""The names of ARKit shapes and Oculus visemes, and how to find them among a mesh's keys."""

import re

# The order is that of the library; a test compares the two.
ARKIT = (
    "eyeBlinkLeft", "eyeLookDownLeft", "eyeLookInLeft", "eyeLookOutLeft", "eyeLookUpLeft",
    "eyeSquintLeft", "eyeWideLeft", "eyeBlinkRight", "eyeLookDownRight", "eyeLookInRight",
    "eyeLookOutRight", "eyeLookUpRight", "eyeSquintRight", "eyeWideRight", "jawForward",
    "jawRight", "jawLeft", "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthRight",
    "mouthLeft", "mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight",
    "mouthDimpleLeft", "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight",
    "mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper", "mouthPressLeft",
    "mouthPressRight", "mouthLowerDownLeft", "mouthLowerDownRight", "mouthUpperUpLeft",
    "mouthUpperUpRight", "browDownLeft", "browDownRight", "browInnerUp", "browOuterUpLeft",
    "browOuterUpRight", "cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft",
    "noseSneerRight", "tongueOut",
)  # fmt: skip
VISEMES = (
    "viseme_sil", "viseme_PP", "viseme_FF", "viseme_TH", "viseme_DD", "viseme_kk", "viseme_CH",
    "viseme_SS", "viseme_nn", "viseme_RR", "viseme_aa", "viseme_E", "viseme_I", "viseme_O",
    "viseme_U",
)  # fmt: skip
# Vowels that VRChat spells differently.
_VRCHAT = {"i": "ih", "o": "oh", "u": "ou"}


def match(keys: list[str]) -> dict[str, str]:
    """Maps shape names to the names of the keys of a mesh that carry them.

    Case, underscores, dots, blanks and anything before the name are ignored; `_L` and `_R` stand
    for Left and Right, on either end. A key serves one shape; if several keys
    fit a shape, the first wins.
    """
    known = _spellings()
    keys_by_shape: dict[str, str] = {}
    for key in keys:
        name = next((known[text] for text in suffixes(key) if text in known), None)
        if name is not None and name not in keys_by_shape:
            keys_by_shape[name] = key
    return {name: keys_by_shape[name] for name in (*ARKIT, *VISEMES) if name in keys_by_shape}


def suffixes(key: str) -> list[str]:
    """A name and its ends after each separator, in lower case and without separators.

    `Head.eye_Blink_L` gives `headeyeblinkl`, `eyeblinkl`, `blinkl`, `l`.
    """
    tokens = [token.lower() for token in re.split(r"[^0-9A-Za-z]+", key) if token]
    return ["".join(tokens[first:]) for first in range(len(tokens))]


def _spellings() -> dict[str, str]:
    spellings = {}
    for name in ARKIT:
        spellings[name.lower()] = name
        for side in ("Left", "Right"):
            if name.endswith(side) and name[: -len(side)] not in ("jaw", "mouth"):
                stem, letter = name[: -len(side)].lower(), side[0].lower()
                spellings |= {stem + letter: name, letter + stem: name, side.lower() + stem: name}
    for name in VISEMES:
        sound = name.removeprefix("viseme_").lower()
        for text in (sound, _VRCHAT.get(sound, sound)):
            spellings |= {f"viseme{text}": name, f"v{text}": name, f"vis{text}": name}
    return spellings
