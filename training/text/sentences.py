"""Splits a sentence into clauses, each with its meaningful and its denied words, a side and an amount.

The lists of `RULES` go into the model's `config.json`, where `rust-core/src/text` reads them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from training.corpus.conditions import UNITS

RULES = {
    "breaks": "and but while then plus also",
    "denials": "not no never without nor neither nothing",
    "left": "left",
    "right": "right",
    "one_sided": "one",
    "unheard": (
        "a an the of or in on at to for from with by as is are was be been being am it its he she "
        "they i you we his her hers their them him my your our me this that these those there here s "
        "t ca wo does do doing did has have had having person persons people man woman men women boy "
        "girl someone somebody face faces facial expression expressions look looks looking looked "
        "seem seems seeming seemed act acts acting like behave behaves behaving talk talks talking "
        "speak speaks speaking feel feels feeling become becomes get gets make makes making shows "
        "showing show appears appear give gives so just only quite rather too more than both"
    ),
    "parts": (
        "brow brows eyebrow eyebrows forehead eye eyes lid lids eyelid eyelids nose nostril nostrils "
        "mouth lip lips jaw chin cheek cheeks teeth"
    ),
    "amounts": {
        "0.4": "barely hardly scarcely faint faintly minimal",
        "0.6": (
            "slightly slight little bit subtle subtly mild mildly weak weakly tiny small hint touch softly"
        ),
        "0.8": "somewhat fairly partly moderate moderately",
        "1.25": (
            "very really strong strongly big broad broadly deep deeply clearly much intense intensely "
            "great truly"
        ),
        "1.5": (
            "extremely huge hugely utterly totally completely wildly enormous immense immensely incredibly"
        ),
    },
}
STRENGTH = (0.1, 2.0)


@dataclass
class Clause:
    """Meaningful words, those after a denial apart; the side that the clause names; a factor of strength.

    `said`: the clause without sides and amounts, its words separated by spaces.
    """

    words: list[str] = field(default_factory=list)
    denied: list[str] = field(default_factory=list)
    side: str | None = None
    amount: float = 1.0
    said: str = field(default="", compare=False)


LISTED = {name: set(words.split()) for name, words in RULES.items() if isinstance(words, str)}
AMOUNTS = {word: float(factor) for factor, words in RULES["amounts"].items() for word in words.split()}


def tokens(text: str) -> list[str]:
    """Lower-case words, and the marks that separate clauses. `n't` becomes the word `not`."""
    plain = text.lower().replace("\u2019", "'").replace("n't", " not").replace("'", " ")
    pieces, word = [], ""
    for letter in plain + " ":
        if is_letter(letter):
            word += letter
            continue
        pieces += [word] if word else []
        pieces += [letter] if letter in ",;.:!?" else []
        word = ""
    return pieces


def is_letter(c: str) -> bool:
    """True for a to z and for U+00C0 upwards, except general and ideographic punctuation."""
    return "a" <= c <= "z" or (c >= "\u00c0" and not ("\u2000" <= c <= "\u206f" or "\u3000" <= c <= "\u303f"))


def clauses(text: str) -> list[Clause]:
    """The clauses of a text; at least one, which may be empty.

    A denied word about a part of the face means the absence of a movement ("no raised eyebrows"). It asks for
    no other movement.
    """
    parsed, denies = [Clause()], False
    for token in tokens(text):
        if token in LISTED["breaks"] or not is_letter(token[0]):
            parsed.append(Clause())
            denies = False
        else:
            denies |= token in LISTED["denials"]
            _hear(parsed[-1], token, denies)
    for clause in parsed:
        if LISTED["parts"] & set(clause.denied):
            clause.denied.clear()
    return parsed


def _hear(clause: Clause, token: str, denies: bool) -> None:
    if token in LISTED["left"] | LISTED["right"] | LISTED["one_sided"]:
        clause.side = next(side for side in ("left", "right", "one_sided") if token in LISTED[side])
    elif token in AMOUNTS:
        clause.amount *= 1.0 if denies else AMOUNTS[token]
    else:
        clause.said = f"{clause.said} {token}".lstrip()
        if token not in LISTED["denials"] | LISTED["unheard"]:
            (clause.denied if denies else clause.words).append(token)


@dataclass(frozen=True)
class Shown:
    """Units by their number in `UNITS`: how strong each is, and which are on one side only."""

    units: dict[int, float]
    one_sided: frozenset[int]

    @staticmethod
    def read(text: str) -> Shown:
        """Reads units such as `12L 45:0.3`: `L` means one side only, the strength follows a colon."""
        units, one_sided = {}, set()
        for item in text.split():
            name, _, strength = item.partition(":")
            number = UNITS.index(name.rstrip("L"))
            units[number] = float(strength or 1.0)
            one_sided |= {number} if name.endswith("L") else set()
        return Shown(units, frozenset(one_sided))

    def __or__(self, other: Shown) -> Shown:
        units = {u: max(self.units.get(u, 0.0), other.units.get(u, 0.0)) for u in self.units | other.units}
        both = (self.units.keys() - self.one_sided) | (other.units.keys() - other.one_sided)
        return Shown(units, (self.one_sided | other.one_sided) - both)


def listed(table: dict[str, str]) -> list[tuple[str, Shown]]:
    """Each text with its units, from a table of units and comma-separated texts."""
    return [(text.strip(), Shown.read(units)) for units, texts in table.items() for text in texts.split(",")]
