"""Files that nobody named: a batch replaces what it wrote itself, and nothing else."""

import pytest

_MINE = "the work of a day"
# The derived names of a batch and of its exports, by the words that make them.
_NAMES = [
    ("jobs.reports/sh0001.json", ()),
    ("jobs.reports/batch.json", ()),
    ("jobs.reports/results.html", ()),
    ("jobs.reports/results.html", ("--sum",)),
    ("jobs.flamenco/anyface.js", ("--export", "flamenco")),
    ("jobs.flamenco/job.json", ("--export", "flamenco")),
    ("jobs.openjd/template.yaml", ("--export", "openjd")),
    ("jobs.slurm/anyface.sh", ("--export", "slurm")),
    ("jobs.opencue/submit.py", ("--export", "opencue")),
]


@pytest.mark.parametrize("by_link", [False, True])
@pytest.mark.parametrize(("name", "words"), _NAMES)
def test_no_derived_name_replaces_a_file_of_the_user(farm, name, words, by_link):
    farm.write(1)
    path = farm.folder / name
    path.parent.mkdir()
    place = farm.folder / "archive" if by_link else path
    place.write_text(_MINE)
    if by_link:
        path.symlink_to(place)
    done = farm.batch(*words)
    assert done.returncode and f"{path}: expected" in done.stderr, done.stderr
    assert place.read_text() == _MINE and path.is_symlink() == by_link
    assert not (farm.folder / "out").exists(), "it refuses before the work"


def test_its_own_files_are_replaced_until_somebody_changes_them(farm):
    farm.write(1)
    for words in ((), ("--again",), ("--sum",)):
        done = farm.batch(*words)
        assert done.returncode == 0, done.stderr
    for chunk in (1, 2):
        script = farm.export("slurm", "--chunk", chunk) / "anyface.sh"
    # The receipts move with their folder.
    script.parent.rename(farm.folder / "other")
    (farm.folder / "other").rename(script.parent)
    farm.export("slurm", "--chunk", 3)
    script.write_text(_MINE)
    assert farm.batch("--export", "slurm").returncode
    assert script.read_text() == _MINE
