"""The table of trainers in docs/training.md is what their arguments say."""

import argparse
from types import ModuleType

import pytest

from training import REPOSITORY, trainers

DOCUMENT = REPOSITORY / "docs/training.md"


def module(**has: object) -> ModuleType:
    """A trainer made up here."""
    trainer = ModuleType("training.made_up", "Trains nothing.")
    vars(trainer).update(has)
    return trainer


def test_the_table_of_the_document_is_that_of_the_arguments():
    written = trainers.parts(DOCUMENT)[1]
    expected = trainers.table()
    rewrite = "run: python -m training.trainers --write docs/training.md"
    assert written == expected, f"{DOCUMENT.name}: the table of trainers is not what they take; {rewrite}"


def test_every_system_has_a_trainer_in_it():
    names = [trainer.__name__.split(".") for trainer in trainers.trainers()]
    systems = {parts[2] for parts in names if parts[1] == "systems"}
    folders = {path.parent.name for path in (REPOSITORY / "training/systems").glob("*/__init__.py")}
    assert systems == folders


def test_a_flag_that_help_hides_is_none_and_a_parser_inside_of_main_is_found():
    def main() -> None:
        parser = argparse.ArgumentParser()
        parser.add_argument("--corpus", nargs="*", help=argparse.SUPPRESS)
        parser.add_argument("--device", choices=["auto", "cpu"])
        parser.add_argument("--recipe", choices=["ours", "paper"])
        parser.parse_args()

    assert trainers.row(module(main=main)) == ["`made_up`", "–", "`--recipe paper`", "yes", "–", "–"]


def test_a_file_called_corpus_is_no_corpus_folder_and_a_checkpoint_is_told():
    parser = argparse.ArgumentParser()
    parser.add_argument("--corpus", help="a file")
    parser.add_argument("--save-every", type=int, default=50)
    parser.add_argument("--precision", choices=["float32", "bfloat16"], default="bfloat16")
    row = trainers.row(module(parser=lambda: parser))
    assert row == ["`made_up`", "–", "–", "–", "`bfloat16`", "yes"]


def test_a_document_without_marks_is_told(tmp_path):
    (tmp_path / "page.md").write_text("nothing")
    with pytest.raises(ValueError, match="expected one line <!-- trainers: begin -->"):
        trainers.main(["--write", str(tmp_path / "page.md")])
