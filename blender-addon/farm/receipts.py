"""Replaces files whose names nobody typed only if this program wrote them.

A file in the same folder keeps a receipt of each of them, a hash of its name and its content. So
the folder may move to another machine.
"""

import hashlib
import os
from contextlib import suppress
from pathlib import Path

from ..core import json_file
from ..core.errors import AnyfaceError

# The command keeps its receipts under the same name. Its hashes are other ones.
FILE = ".anyface-receipts"


def check(*paths: Path) -> None:
    """Raises `AnyfaceError("file")` for a path with a file or a link of somebody else."""
    for path in paths:
        if os.path.lexists(path) and not _is_ours(path):
            text = (
                f"{path}: expected nothing here, or what anyface wrote here and nobody changed, "
                "got another file: move it away"
            )
            raise AnyfaceError("file", text)


def write(path: Path, text: str) -> None:
    """Writes a text file and keeps its receipt; raises `AnyfaceError("file")` as `check` does."""
    check(path)
    receipt = _receipt(path, text.encode("utf-8", "backslashreplace"))
    # Without its receipt the file will count as the user's. The receipt comes first, so that the
    # file has one even if this process is killed in between.
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path.with_name(FILE), "a", encoding="ascii") as receipts:
            receipts.write(f"\n{receipt}")
    json_file.write_text(path, text)


def _is_ours(path: Path) -> bool:
    try:
        receipts = path.with_name(FILE).read_text(encoding="ascii").splitlines()
        is_file = path.is_file() and not path.is_symlink()
        return is_file and _receipt(path, path.read_bytes()) in receipts
    except (OSError, UnicodeError):
        return False


def _receipt(path: Path, content: bytes) -> str:
    name = path.name.encode("utf-8", "surrogateescape")
    return hashlib.blake2b(name + b"\0" + content, digest_size=32).hexdigest()
