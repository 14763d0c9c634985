"""Unpacks the wheel, as pip does, and hands it to the tests.

`ANYFACE_WHEEL` names the wheel; without it `cargo xtask wheel` builds one.
"""

import importlib
import os
import sys
import zipfile
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import RATE_HZ, ROOT, find_wheel, spoken, write_wav  # noqa: F401

HEAD = ROOT / "weights/shared/default_head/head.obj"


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    """The wheel under test."""
    return find_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="session")
def anyface(wheel, tmp_path_factory):
    """The package of the wheel; its cache of meshes is a separate folder."""
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))
    site = tmp_path_factory.mktemp("site")
    zipfile.ZipFile(wheel).extractall(site)
    sys.path.insert(0, str(site))
    package = importlib.import_module("anyface")
    assert package.__file__.startswith(str(site))
    return package


@pytest.fixture(scope="session")
def voice(tmp_path_factory):
    """A WAV file of `spoken`, 16 bit."""
    path = tmp_path_factory.mktemp("voice") / "voice.wav"
    write_wav(path, spoken())
    return path


@pytest.fixture(scope="session")
def clip(anyface, voice):
    """The default head, speaking."""
    return anyface.animate(HEAD, voice, fps=25, weights=True)
