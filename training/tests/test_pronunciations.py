"""Tests of the table of pronunciations."""

from training.speech.phones import CLASSES
from training.speech.pronunciations import FIRST_LETTER, FIRST_PHONE, LETTERS, codes_of, read


def test_the_first_pronunciation_of_plain_words_counts(tmp_path):
    """Words with digits or points are left out, and so are comments."""
    path = tmp_path / "dictionary"
    path.write_text("what W AH1 T # a comment\nwhat(2) HH W AH1 T\na.m. EY1 EH1 M\nabout AH0 B AW1 T\n")
    assert read(path) == {"about": "əbaʊt", "what": "wʌt"}


def test_codes_share_the_letters_of_the_word_before():
    """An entry is a count, the other letters, and the phones."""
    classes = list(CLASSES)
    codes = codes_of({"ha": "ha", "hat": "hæt"})
    letters = [FIRST_LETTER + LETTERS.index(letter) for letter in "hat"]
    phones = {sign: FIRST_PHONE + classes.index(sign) for sign in "haæt"}
    first = [0, *letters[:2], phones["h"], phones["a"]]
    assert codes == [*first, 2, letters[2], phones["h"], phones["æ"], phones["t"]]
