"""Installs the extension's zip into an empty Blender of its own and hands it to the tests.

`ANYFACE_EXTENSION` names the zip; without it `cargo xtask extension` builds one.
"""

import atexit
import importlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Blender reads this once, at import. The user's own Blender stays untouched.
_RESOURCES = tempfile.mkdtemp(prefix="anyface-blender-")
atexit.register(shutil.rmtree, _RESOURCES, ignore_errors=True)
os.environ["BLENDER_USER_RESOURCES"] = _RESOURCES
os.environ.setdefault("XDG_CACHE_HOME", os.path.join(_RESOURCES, "cache"))

import bpy  # noqa: E402

# The tests' exit status, kept for the moment when Python ends.
_status = 0

PACKAGE = "bl_ext.user_default.anyface"


def zip_path() -> Path:
    """The zip under test."""
    extension = os.environ.get("ANYFACE_EXTENSION")
    if extension:
        return Path(extension)
    path = Path(_RESOURCES) / "anyface.zip"
    command = ["cargo", "xtask", "extension", "--out", str(path)]
    subprocess.run(command, cwd=ROOT, check=True)
    return path


@pytest.fixture(scope="session", autouse=True)
def installed():
    """The folder of the installed extension."""
    result = bpy.ops.extensions.package_install_files(
        filepath=str(zip_path()), repo="user_default", enable_on_install=True
    )
    assert result == {"FINISHED"}
    # A zip for another platform is skipped with the same result.
    assert PACKAGE in bpy.context.preferences.addons
    module = importlib.import_module(PACKAGE)
    folder = Path(module.__file__).parent
    assert _RESOURCES in str(folder)
    return folder


@pytest.fixture(autouse=True)
def empty_file(installed):
    """A new file for every test; the extension stays enabled."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert hasattr(bpy.types.Object, "anyface")
    running = importlib.import_module(f"{PACKAGE}.ui.running")
    yield
    running._engines.clear()
    importlib.import_module(f"{PACKAGE}.core.finding")._failed.clear()


@pytest.fixture
def addon():
    """`addon("scene.takes.keys")` is that module of the installed extension."""
    return lambda name: importlib.import_module(f"{PACKAGE}.{name}")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(call):
    """Skips tests of sounds in a Blender without Audaspace, such as bpy 4.2 for Windows."""
    if call.excinfo is not None and "without Audaspace" in str(call.excinfo.value):
        ignored = pytest.skip.Exception("ignored, this Blender has no Audaspace")
        traceback = call.excinfo.tb
        call.excinfo = pytest.ExceptionInfo.from_exc_info((type(ignored), ignored, traceback))


def pytest_sessionfinish(exitstatus):
    """Remembers the tests' exit status."""
    global _status
    _status = int(exitstatus)


def pytest_unconfigure():
    """Exits at once: after an add-on, bpy 4.2 crashes and bpy 4.5 may hang while Python ends."""
    if bpy.app.version < (5, 0):
        shutil.rmtree(_RESOURCES, ignore_errors=True)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_status)
