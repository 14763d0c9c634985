"""A real Blender, as bpy and as an executable, subscribes to the site, installs and updates.

`ANYFACE_BLENDER` names the executable. The tests contact only this machine.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import HEAD, HERE, OTHERS, packages, served, write_site

SCRIPT = Path(__file__).with_name("blender_session.py")


def starts():
    """Commands that run a script in a Blender."""
    yield pytest.param([sys.executable], id="bpy")
    blender = os.environ.get("ANYFACE_BLENDER") or shutil.which("blender")
    missing = pytest.mark.skipif(blender is None, reason="ignored: no blender executable here")
    command = [blender, "-b", "--online-mode", "--python-exit-code", "1", "--python"]
    yield pytest.param(command, id="executable", marks=missing)


@pytest.fixture(params=starts())
def session(request, voice, tmp_path):
    """`session(action, address)` runs a new Blender of the same user; returns its result."""
    user = tmp_path / "user"
    user.mkdir()
    # The executable may see only the folder for temporary files.
    files = [shutil.copy(path, tmp_path) for path in (SCRIPT, HEAD, voice)]

    def run(action, address):
        command = [*request.param, files[0], "--", action, address, *files[1:]]
        environment = {**os.environ, "BLENDER_USER_RESOURCES": str(user)}
        environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
        done = subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        results = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
        assert done.returncode == 0 and results, done.stdout + done.stderr
        return json.loads(results[-1].removeprefix("RESULT "))

    return run


def test_it_installs_speaks_and_updates(extension, session, tmp_path):
    folder = tmp_path / "site"
    write_site(folder, "--packages", packages(extension, tmp_path / "first", "0.1.0"))
    with served(folder) as address:
        address += "/extensions/index.json"
        installed = session("install", address)
        assert installed["moved_mm"] > 3.0
        assert (installed["version"], installed["platforms"]) == ("0.1.0", [HERE])
        write_site(folder, "--packages", packages(extension, tmp_path / "second", "0.2.0"))
        assert session("update", address)["version"] == "0.2.0"
        later = session("speak", address)
    # In a new session the new version speaks like the old one and keeps the artist's settings.
    assert later == {**installed, "version": "0.2.0"}
    assert later["enabled"] and later["threads"] == 3


def test_the_list_tells_systems_apart(site):
    data = json.loads((site / "extensions/index.json").read_text())["data"]
    systems = {item["archive_url"]: item["platforms"] for item in data}
    assert systems == {f"./anyface-0.1.0-{name}.zip": [name] for name in (HERE, *OTHERS)}
