"""What fields of a JSON object may hold, with messages that name row and field."""

from collections.abc import Mapping

from .errors import AnyfaceError

TEXT = "text"
NUMBER = "a number"
TRUTH = "true or false"
OBJECT = "an object"
LIST = "a list"
NOTHING = "nothing"
# What an option of a command line may be.
SCALAR = (TEXT, NUMBER, TRUTH, NOTHING)


def kind(value) -> str:
    """The word for what a value is."""
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return TRUTH
    if isinstance(value, int | float):
        return NUMBER
    if isinstance(value, str):
        return TEXT
    return OBJECT if isinstance(value, dict) else LIST


def check(where: str, value, *kinds: str):
    """Returns `value` if it is of one of `kinds`; `where` is its row and field.

    Raises `AnyfaceError("input")`.
    """
    if kind(value) not in kinds:
        expected = " or ".join(kinds)
        raise AnyfaceError("input", f"{where}: expected {expected}, got {_shown(value)}")
    return value


def fields(where: str, row, rules: Mapping[str, tuple[str, ...]], others=None) -> dict:
    """Returns `row` if it is an object whose fields hold what `rules` say by name.

    `others` is what fields without a rule may hold; None refuses them. Raises
    `AnyfaceError("input")`.
    """
    check(where, row, OBJECT)
    for name, value in row.items():
        kinds = rules.get(name, others)
        if kinds is None:
            raise AnyfaceError(
                "input", f"{where}: expected some of {', '.join(rules)}, got {name!r}"
            )
        check(f"{where}: {name}", value, *kinds)
    return row


def _shown(value) -> str:
    """A value in a message: short ones as they are."""
    text = repr(value)
    return text if len(text) <= 60 else f"{kind(value)} ({text[:40]}…)"
