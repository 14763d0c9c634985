"""Makes the table of all trainers in docs/training.md from their command-line arguments.

python -m training.trainers                           # prints it
python -m training.trainers --write docs/training.md  # replaces the old one
"""

import argparse
import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

from training import REPOSITORY
from training.flags import run_command

BEGIN, END = "<!-- trainers: begin -->", "<!-- trainers: end -->"
HEADING = [
    "`python -m training.…`",
    "corpus folders",
    "paper's recipe",
    "`--device`",
    "`--precision`",
    "goes on",
]
YES, NO = "yes", "–"


class ParserReached(Exception):
    """Carries the parser of a command that was about to parse its arguments."""


def trainers() -> Iterator[ModuleType]:
    """Every training module that runs as a command, in the order of their names."""
    for path in sorted((REPOSITORY / "training").rglob("*train*.py")):
        names = path.relative_to(REPOSITORY).with_suffix("").parts
        is_trainer = path.stem.startswith("train") or path.stem.endswith("train")
        if is_trainer and names[1] != "tests" and '__name__ == "__main__"' in path.read_text():
            if path.stem != "trainers":
                yield importlib.import_module(".".join(names))


def parser_of(trainer: ModuleType) -> argparse.ArgumentParser:
    """A trainer's parser. If the trainer has only `main`, runs that until it is about to parse."""
    if hasattr(trainer, "parser"):
        return trainer.parser()

    def ask(parser: argparse.ArgumentParser, *_line: object) -> None:
        raise ParserReached(parser)

    try:
        with patch.object(argparse.ArgumentParser, "parse_args", ask):
            # A function whose parameters are the flags would train if it were called by itself.
            if hasattr(trainer, "run_command"):
                run_command(trainer.main)
            trainer.main()
    except ParserReached as reached:
        return reached.args[0]
    raise ValueError(
        f"{trainer.__name__}: expected a parser() or a main() that parses arguments, got neither"
    )


def row(trainer: ModuleType) -> list[str]:
    """A trainer's row of the table, in the order of `HEADING`."""
    parser = parser_of(trainer)
    flags = {action.dest: action for action in parser._actions if action.help != argparse.SUPPRESS}
    corpus, recipe, precision = (flags.get(name) for name in ("corpus", "recipe", "precision"))
    goes_on = parser.get_default("save_every") is not None or "last.pt" in trainer.__doc__
    return [
        f"`{trainer.__name__.removeprefix('training.')}`",
        YES if corpus is not None and "corpus folder" in (corpus.help or "") else NO,
        "`--recipe paper`" if recipe is not None and "paper" in recipe.choices else NO,
        YES if "device" in flags else NO,
        NO if precision is None else f"`{precision.default}`",
        YES if goes_on else NO,
    ]


def table() -> str:
    """All rows, in Markdown."""
    rows = [HEADING, ["---"] * len(HEADING), *map(row, trainers())]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def parts(document: Path) -> tuple[str, str, str]:
    """The text before the table, the table, and the text after it."""
    text = document.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"{document}: expected one line {BEGIN} and one {END} around the table")
    before, rest = text.split(BEGIN)
    inside, after = rest.split(END)
    return before, inside.strip(), after


def main(line: list[str] | None = None) -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, help="the document whose table is replaced")
    document = parser.parse_args(line).write
    if document is None:
        print(table())
        return
    before, _, after = parts(document)
    document.write_text(f"{before}{BEGIN}\n{table()}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
