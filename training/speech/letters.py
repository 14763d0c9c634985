"""Finds when the words of a text are said: letters, the phones that each may stand for, and the best path.

Twin of `rust-core/src/speech/alignment.rs`, which also reads English words in a dictionary
(`training.speech.pronunciations`). Here a text becomes units, each a letter or one of the groups below, and
`table` [U, K] has the probability that a unit sounds as each class of phones. A unit may be silent. Pauses
may occur before, between and after words. The most probable path (Viterbi 1967) through the frames tells
when each unit is spoken.
"""

import unicodedata
from dataclasses import dataclass

import numpy as np

from training.speech.phones import CLASSES

GROUPS = (
    "sch", "tch", "igh", "sh", "ch", "th", "ng", "ph", "ck", "gh", "ee", "oo", "ou", "ea", "ie", "ei", "eu",
    "au", "ui", "ij", "oe", "ai", "ow", "qu", "aa",
)  # fmt: skip
"""Groups of letters that together spell one sound, the longest first."""

ANY = "*"
"""Stands for a letter whose sound is unknown."""

UNITS = (*"abcdefghijklmnopqrstuvwxyz", *GROUPS, ANY)
VOWEL_UNITS = {u for u in UNITS if u[0] in "aeiouy"}
MAY_BE_WORDS = [index for index, unit in enumerate(UNITS) if len(unit) > 1 or unit[0] in "aeiouy*"]
"""Indices of units that can be a word on their own. Any other letter that stands alone is spoken by its name,
which has a vowel before or after it.
"""

SPECIAL = {
    "ß": "ss", "ä": "e", "ö": "oe", "ø": "oe", "œ": "oe", "æ": "e", "ł": "w", "ı": "i", "ð": "th", "þ": "th",
    "đ": "d",
}  # fmt: skip

RULES = {
    "a": "aɑæəeɛʌɔ", "b": "bp", "c": "ksʃ", "d": "dt", "e": "eɛəiɪ", "f": "fv", "g": "ɡʒx", "h": "hx",
    "i": "iɪaəj", "j": "jʒdx", "k": "kɡ", "l": "l", "m": "m", "n": "nŋ", "o": "oɔəʌuʊɑ", "p": "pb", "q": "k",
    "r": "rɹʁɝəʌ", "s": "szʃ", "t": "td", "u": "uʊʌyjwə", "v": "vf", "w": "wvu", "x": "ksz", "y": "ijɪay",
    "z": "zst", "sch": "ʃsx", "tch": "tʃ", "igh": "aɪ", "sh": "ʃ", "ch": "ʃtkx", "th": "θðt", "ng": "ŋnɡ",
    "ph": "f", "ck": "k", "gh": "ɡf", "ee": "ieɪ", "oo": "uʊo", "ou": "aʊuɔ", "ea": "iɛeɪ", "ie": "iɪ",
    "ei": "aɪeɛ", "eu": "ɔøɪ", "au": "aʊɔ", "ui": "øyuɪ", "ij": "ɛɪ", "oe": "uøo", "ai": "aɪeɛ", "ow": "oʊa",
    "qu": "kw", "aa": "aɑ",
}  # fmt: skip
"""Phone classes that each unit can stand for in any language of Europe."""

PHONES = tuple(f"/{sign}" for sign in CLASSES if sign != "_")
"""Units of words in a dictionary: a slash and a phone class."""

ALSO = {
    "ɑ": "ɔaʌ", "æ": "aɛə", "ʌ": "əɑɪ", "ɔ": "ɑoʊ", "ə": "ʌɪɛ", "ɛ": "eæɪ", "e": "ɛɪ", "ɪ": "iəɛ", "i": "ɪ",
    "ɝ": "ɹəɔ", "o": "ɔʊə", "ʊ": "uəw", "u": "ʊyw", "a": "ɑæʌ", "t": "d", "d": "t", "s": "z", "z": "s",
    "ð": "dθ", "θ": "ðt", "v": "f", "f": "v", "p": "b", "b": "p", "ɡ": "k", "k": "ɡ", "ɹ": "rɝw",
    "w": "uv", "h": "x", "j": "i", "ʃ": "ʒ", "ʒ": "ʃ", "n": "ŋ", "ŋ": "n",
}  # fmt: skip
"""Classes as which a phone of the dictionary is also said or heard."""
ALSO_SHARE = 0.2

LEAST_ROWS = 3
"""Number of successive states of a unit. A letter lasts this many rows or more, unless a path skips some."""

LONGEST_SKIP = 2 * LEAST_ROWS + 1
"""Most successive states that a path may skip: two letters and a pause."""

NEVER = 1e9
"""Cost in nepers of skipping a unit that must be heard."""

SILENT_COST = 5.0
"""Cost in nepers of skipping a letter, which is then silent."""

NAME_COST = 1.0
"""Cost in nepers of skipping a vowel in the name of a letter."""


@dataclass
class States:
    """States of a path, [N] each. The indices `unit` and `word` are −1 for a pause; `skip` is a cost."""

    unit: np.ndarray
    word: np.ndarray
    skip: np.ndarray


def romanised(word: str) -> str:
    """The word in letters a to z, with `*` for digits and other scripts. Diacritics and signs are dropped."""
    letters = []
    for sign in word.lower():
        plain = SPECIAL.get(sign) or unicodedata.normalize("NFD", sign)[0]
        if plain[0] in "abcdefghijklmnopqrstuvwxyz":
            letters.append(plain)
        elif sign.isalnum():
            letters.append(ANY)
    return "".join(letters)


def units(word: str) -> list[int]:
    """Units of a word. A doubled consonant counts once."""
    letters, indices, at = romanised(word), [], 0
    while at < len(letters):
        unit = next((g for g in GROUPS if letters.startswith(g, at)), letters[at])
        at += len(unit)
        index = UNITS.index(unit)
        doubled = unit != ANY and unit not in VOWEL_UNITS and indices and indices[-1] == index
        if not doubled:
            indices.append(index)
    return indices


def states_of(words: list[str], silent_cost: float = SILENT_COST) -> States:
    """States of a pause, then of a word's units, then a pause, and so on. Words without letters get none."""
    unit, word, skip = [-1], [-1], [0.0]
    for index, text in enumerate(words):
        spelling = units(text)
        if not spelling:
            continue
        spelled = len(spelling) == 1 and spelling[0] not in MAY_BE_WORDS
        if spelled:
            spelling = [UNITS.index(ANY), spelling[0], UNITS.index(ANY)]
        for place, u in enumerate(spelling):
            unit += [u] * LEAST_ROWS
            word += [index] * LEAST_ROWS
            # A path may skip two units, so a word of one or two could vanish between two pauses. Its first
            # unit must be heard. Of a letter spoken by its name, the letter itself must be heard.
            must = place == 1 if spelled else len(spelling) == 1 or len(spelling) == 2 and place == 0
            cost = NEVER if must else NAME_COST if spelled else silent_cost
            skip += [cost / LEAST_ROWS] * LEAST_ROWS
        unit.append(-1)
        word.append(-1)
        skip.append(0.0)
    return States(np.array(unit), np.array(word), np.array(skip))


def table_of_rules(smooth: float = 0.05) -> np.ndarray:
    """`RULES` as probabilities [U, K]. The share `smooth` is spread evenly over all classes."""
    signs = list(CLASSES)
    table = np.full((len(UNITS), len(signs)), smooth / len(signs))
    for index, unit in enumerate(UNITS):
        kinds = [signs.index(s) for s in RULES.get(unit, "".join(signs[1:]))]
        table[index, kinds] += (1.0 - smooth) / len(kinds)
    return table


def table_of_phones(smooth: float = 0.05) -> np.ndarray:
    """Probabilities [P, K] of the classes for each unit of `PHONES`: mostly its own, then those of `ALSO`."""
    signs = list(CLASSES)
    table = np.full((len(PHONES), len(signs)), smooth / len(signs))
    for row, unit in zip(table, PHONES, strict=True):
        also = [signs.index(s) for s in ALSO.get(unit[1:], unit[1:])]
        row[also] += ALSO_SHARE / len(also)
        row[signs.index(unit[1:])] += 1.0 - smooth - ALSO_SHARE
    return table


def emissions(log_likelihood: np.ndarray, table: np.ndarray, states: States) -> np.ndarray:
    """Nepers of each frame in each state, [T, N]. `log_likelihood` [T, K] is log p(k | x) − log p(k)."""
    top = log_likelihood.max(axis=1, keepdims=True)
    of_units = np.log(np.exp(log_likelihood - top) @ table.T) + top
    every = np.concatenate([of_units, log_likelihood[:, :1]], axis=1)
    return every[:, states.unit]


def best_path(emission: np.ndarray, skip: np.ndarray) -> np.ndarray:
    """State of each frame [T] on the most probable path; `emission` [T, N], `skip` [N] costs.

    At each frame a path stays in its state, moves to the next, or skips up to `LONGEST_SKIP` states at their
    cost.
    """
    frames, count = emission.shape
    before = np.concatenate([[0.0], np.cumsum(skip)])
    costs = np.full((LONGEST_SKIP + 2, count), np.inf)
    costs[0] = 0.0
    for step in range(1, min(LONGEST_SKIP + 1, count - 1) + 1):
        costs[step, step:] = before[step:count] - before[1 : count - step + 1]
    score = np.full(count, -np.inf)
    score[: LONGEST_SKIP + 1] = -before[:count][: LONGEST_SKIP + 1]
    score = score + emission[0]
    back = np.zeros((frames, count), np.int8)
    for t in range(1, frames):
        moves = np.full((LONGEST_SKIP + 2, count), -np.inf)
        for step in range(min(LONGEST_SKIP + 2, count)):
            moves[step, step:] = score[: count - step]
        moves -= costs
        back[t] = moves.argmax(axis=0)
        score = moves.max(axis=0) + emission[t]
    last = score - (before[-1] - before[1:])
    last[: max(0, count - LONGEST_SKIP - 1)] = -np.inf
    path = np.zeros(frames, int)
    path[-1] = int(last.argmax())
    for t in range(frames - 1, 0, -1):
        path[t - 1] = path[t] - back[t, path[t]]
    return path


def word_times(
    path: np.ndarray, states: States, rate_hz: float, first_s: float
) -> dict[int, tuple[float, float]]:
    """Start and end in seconds of each word on a path. A row covers half a step to either side."""
    times = {}
    for word in np.unique(states.word[states.word >= 0]):
        rows = np.flatnonzero(states.word[path] == word)
        if len(rows):
            times[int(word)] = tuple(
                first_s + (row + shift) / rate_hz for row, shift in ((rows[0], -0.5), (rows[-1], 0.5))
            )
    return times
