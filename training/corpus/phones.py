"""Phones with times, and how the mouth forms each of them.

Three kinds of labels are known: IPA (with stress, length and diacritics), ARPABET in capitals, and
the names of pauses. Every label becomes one or two plain IPA segments; a diphthong splits 60/40.
The articulatory features come from textbook phonetics (International Phonetic Association 1999) and are
graded by how visible they are on a face.
"""

import unicodedata
from dataclasses import dataclass

import numpy as np

FEATURES = (
    "silence",
    "vowel",
    "closed",
    "labiodental",
    "round",
    "open",
    "high",
    "front",
    "coronal",
    "voiced",
    "fricative",
    "nasal",
)
PAUSE = "_"
PAUSES = {"", "_", "sil", "sp", "spn", "pau", "<sil>", "h#", "#"}
FIRST_HALF = 0.6
LONGEST_PLOSIVE_S = 0.14
ROUNDING = 1e-6
PLOSIVES = set("pbtdkɡqɢʔcɟʈɖ")

VOWELS = {
    "i": (0.15, 1.0, 1.0, 0.0),
    "y": (0.1, 1.0, 1.0, 0.9),
    "ɨ": (0.15, 1.0, 0.5, 0.0),
    "ʉ": (0.15, 1.0, 0.5, 0.8),
    "ɯ": (0.15, 1.0, 0.0, 0.1),
    "u": (0.1, 1.0, 0.0, 1.0),
    "ɪ": (0.3, 0.8, 0.8, 0.0),
    "ʏ": (0.25, 0.8, 0.8, 0.7),
    "ʊ": (0.25, 0.8, 0.2, 0.7),
    "e": (0.4, 0.7, 1.0, 0.0),
    "ø": (0.3, 0.7, 0.9, 0.8),
    "ɘ": (0.4, 0.6, 0.5, 0.0),
    "ɵ": (0.35, 0.6, 0.5, 0.7),
    "ɤ": (0.4, 0.6, 0.0, 0.1),
    "o": (0.4, 0.6, 0.0, 0.9),
    "ə": (0.4, 0.5, 0.5, 0.1),
    "ɛ": (0.65, 0.35, 0.9, 0.0),
    "œ": (0.55, 0.35, 0.8, 0.6),
    "ɜ": (0.55, 0.4, 0.5, 0.1),
    "ɞ": (0.55, 0.4, 0.5, 0.5),
    "ʌ": (0.65, 0.3, 0.2, 0.0),
    "ɔ": (0.65, 0.3, 0.0, 0.6),
    "æ": (0.85, 0.1, 0.9, 0.0),
    "ɐ": (0.75, 0.2, 0.5, 0.0),
    "a": (1.0, 0.0, 0.6, 0.0),
    "ɑ": (1.0, 0.0, 0.1, 0.0),
    "ɒ": (0.9, 0.0, 0.0, 0.5),
    "ɚ": (0.4, 0.5, 0.5, 0.3),
    "ɝ": (0.5, 0.5, 0.5, 0.3),
}
"""Vowel → how open, high, front and round it is, each from 0 to 1."""

CONSONANTS = {
    "p": "closed",
    "b": "closed voiced",
    "m": "closed voiced nasal",
    "ɸ": "closed:0.5 fricative",
    "β": "closed:0.5 voiced fricative",
    "ʙ": "closed voiced",
    "f": "labiodental fricative",
    "v": "labiodental fricative voiced",
    "ʋ": "labiodental voiced",
    "ɱ": "labiodental voiced nasal",
    "w": "round voiced high",
    "ʍ": "round high",
    "ɥ": "round voiced high front",
    "t": "coronal",
    "d": "coronal voiced",
    "ʈ": "coronal",
    "ɖ": "coronal voiced",
    "n": "coronal voiced nasal",
    "ɳ": "coronal voiced nasal",
    "θ": "coronal fricative",
    "ð": "coronal fricative voiced",
    "s": "coronal fricative",
    "z": "coronal fricative voiced",
    "ʃ": "coronal fricative round:0.6",
    "ʒ": "coronal fricative voiced round:0.6",
    "ʂ": "coronal fricative round:0.4",
    "ʐ": "coronal fricative voiced round:0.4",
    "ɕ": "coronal fricative front round:0.3",
    "ʑ": "coronal fricative voiced front round:0.3",
    "ɬ": "coronal fricative",
    "l": "coronal voiced open:0.2",
    "ɫ": "coronal voiced open:0.2",
    "ɭ": "coronal voiced open:0.2",
    "ʎ": "voiced front high open:0.2",
    "r": "coronal voiced open:0.2",
    "ɾ": "coronal voiced open:0.2",
    "ɹ": "coronal voiced round:0.5 open:0.1",
    "ɻ": "coronal voiced round:0.5 open:0.1",
    "ɽ": "coronal voiced open:0.2",
    "j": "voiced high front open:0.15",
    "ç": "fricative high front open:0.15",
    "ʝ": "fricative voiced high front open:0.15",
    "c": "high front",
    "ɟ": "high front voiced",
    "ɲ": "high front voiced nasal",
    "k": "open:0.25",
    "ɡ": "open:0.25 voiced",
    "ŋ": "open:0.25 voiced nasal",
    "q": "open:0.3",
    "ɢ": "open:0.3 voiced",
    "x": "open:0.3 fricative",
    "ɣ": "open:0.3 fricative voiced",
    "χ": "open:0.3 fricative",
    "ʁ": "open:0.3 fricative voiced",
    "ʀ": "open:0.3 voiced",
    "ħ": "open:0.4 fricative",
    "ʕ": "open:0.4 fricative voiced",
    "h": "open:0.4 fricative",
    "ɦ": "open:0.4 fricative voiced",
    "ʔ": "open:0.3",
}
"""Consonant → its features. A feature has the value 1 unless a number follows it."""

SEGMENTS = (PAUSE, *VOWELS, *CONSONANTS)
"""Every plain segment. Frame classifiers use a segment's index here as its class."""

BILABIALS = tuple(SEGMENTS.index(s) for s in "pbm")
"""Classes of the segments that close the lips."""

ARPABET = {
    "AA": "ɑ", "AE": "æ", "AH": "ʌ", "AO": "ɔ", "AW": "aʊ", "AY": "aɪ", "B": "b", "CH": "tʃ",
    "D": "d", "DH": "ð", "EH": "ɛ", "ER": "ɝ", "EY": "eɪ", "F": "f", "G": "ɡ", "HH": "h",
    "IH": "ɪ", "IY": "i", "JH": "dʒ", "K": "k", "L": "l", "M": "m", "N": "n", "NG": "ŋ",
    "OW": "oʊ", "OY": "ɔɪ", "P": "p", "R": "ɹ", "S": "s", "SH": "ʃ", "T": "t", "TH": "θ",
    "UH": "ʊ", "UW": "u", "V": "v", "W": "w", "Y": "j", "Z": "z", "ZH": "ʒ",
}  # fmt: skip
SPELLINGS = {"g": "ɡ", "ᵻ": "ɪ", "ɚ": "ɚ", "ɩ": "ɪ", "ɷ": "ʊ", "ʦ": "ts", "ʣ": "dz", "ʧ": "tʃ", "ʤ": "dʒ"}


@dataclass(frozen=True)
class Phone:
    """One phone of an utterance, with times in seconds."""

    start_s: float
    duration_s: float
    label: str

    @property
    def end_s(self) -> float:
        """When the phone ends."""
        return self.start_s + self.duration_s


def segments(label: str) -> list[str]:
    """Plain IPA segments of a label: `ˈaɪ` → a, ɪ; `AH0` → ʌ; a pause → `_`; unknown → none."""
    if label.lower() in PAUSES:
        return [PAUSE]
    label = ARPABET.get(label.rstrip("012"), label)
    plain_segments = []
    for sign in label:
        plain = sign if sign in CONSONANTS else unicodedata.normalize("NFD", sign)[0]
        plain_segments += [s for s in SPELLINGS.get(plain, plain) if s in VOWELS or s in CONSONANTS]
    return plain_segments


def split(phone: Phone) -> list[tuple[float, float, str]]:
    """Splits a phone into parts (start, end, segment). A plosive's closure lasts at most 0.14 s.

    The limit is needed because aligners let the silence before an utterance run into its first plosive.
    """
    parts = segments(phone.label)
    if len(parts) < 2:
        start = phone.start_s
        if parts and parts[0] in PLOSIVES:
            start = max(start, phone.end_s - LONGEST_PLOSIVE_S)
        return [(start, phone.end_s, part) for part in parts]
    first = FIRST_HALF if len(parts) == 2 else 1.0 / len(parts)
    shares = [0.0, first, *(first + (1 - first) * (k + 1) / (len(parts) - 1) for k in range(len(parts) - 1))]
    ends = [phone.start_s + share * phone.duration_s for share in shares]
    return [(ends[k], ends[k + 1], part) for k, part in enumerate(parts)]


def segment_track(phones: list[Phone], frames: int, rate_hz: float) -> np.ndarray:
    """Class of each frame [T] int16: index into `SEGMENTS`, 0 (a pause) where nothing is said.

    Frame t is at t / `rate_hz` seconds.
    """
    track = np.zeros(frames, np.int16)
    for phone in phones:
        for start, end, segment in split(phone):
            first, last = (int(np.ceil(x * rate_hz - ROUNDING)) for x in (start, end))
            track[max(first, 0) : max(last, 0)] = SEGMENTS.index(segment)
    return track


def feature_table() -> np.ndarray:
    """Articulatory features of every segment, [len(SEGMENTS), len(FEATURES)] in 0 … 1."""
    table = np.zeros((len(SEGMENTS), len(FEATURES)), np.float32)
    table[0, FEATURES.index("silence")] = 1.0
    for segment, (opened, high, front, rounded) in VOWELS.items():
        row = table[SEGMENTS.index(segment)]
        row[[FEATURES.index(f) for f in ("vowel", "voiced", "open", "high", "front", "round")]] = [
            1.0,
            1.0,
            opened,
            high,
            front,
            rounded,
        ]
    for segment, text in CONSONANTS.items():
        for item in text.split():
            name, _, value = item.partition(":")
            table[SEGMENTS.index(segment), FEATURES.index(name)] = float(value or 1.0)
    return table


def bilabials(phones: list[Phone]) -> list[tuple[float, float]]:
    """The spans in which p, b and m need closed lips: (start, end) in seconds.

    A span starts before the phone, by half the length of the previous segment clamped to 40 … 120 ms. It ends
    with the phone.
    """
    spans, before = [], 0.08
    for phone in phones:
        for start, end, segment in split(phone):
            if segment in "pbm":
                spans.append((start - min(max(before / 2, 0.04), 0.12), end))
            before = end - start
    return spans
