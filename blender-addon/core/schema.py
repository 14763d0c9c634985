"""Checks the fields of a JSON object; error messages name the row and the field."""

from collections.abc import Mapping

from .errors import AnyfaceError

TEXT = "text"
NUMBER = "a number"
TRUTH = "true or false"
OBJECT = "an object"
LIST = "a list"
NOTHING = "nothing"
# The kinds of value that a command-line option may have.
SCALAR = (TEXT, NUMBER, TRUTH, NOTHING)


def kind(value) -> str:
    """The word for the kind of a value."""
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
    """Returns `row` if it is an object whose fields have the kinds that `rules` list by name.

    `others` are the kinds for fields without a rule; None refuses such fields. Raises
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
    """A value for a message; long ones are shortened."""
    text = repr(value)
    return text if len(text) <= 60 else f"{kind(value)} ({text[:40]}…)"
