"""pip installs the wheel from the site and from its folder, and the package makes a clip."""

import os
import subprocess
import sys
import sysconfig
import venv

import pytest

from conftest import HEAD, served

CLIP = """
import sys, anyface
clip = anyface.animate(sys.argv[1], sys.argv[2], fps=25)
print(anyface.__file__)
print(abs(clip.displacements).max())
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """The Python of an empty environment that sees the numpy of this one."""
    folder = tmp_path_factory.mktemp("clean")
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    ask = [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    packages = subprocess.run(ask, capture_output=True, text=True, check=True).stdout.strip()
    with open(os.path.join(packages, "numpy_of_the_tests.pth"), "w") as file:
        file.write(sysconfig.get_path("purelib") + "\n")
    return python


@pytest.mark.parametrize("way", ["index", "links", "folder"])
def test_it_installs_and_animates(way, site, python, voice, tmp_path):
    pip = [python, "-m", "pip", "-q"]
    subprocess.run([*pip, "uninstall", "-y", "anyface"], check=True)
    with served(site) as address:
        words = {
            "index": ["--index-url", f"{address}/wheels/"],
            "links": ["--no-index", "--find-links", f"{address}/wheels/anyface/"],
            "folder": ["--no-index", "--find-links", site / "wheels/anyface"],
        }[way]
        subprocess.run([*pip, "install", "--no-cache-dir", *words, "anyface"], check=True)
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    command = [python, "-c", CLIP, HEAD, voice]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    place, largest = done.stdout.split()
    assert place.startswith(str(python.parents[1])) and float(largest) > 0.003


def test_pip_refuses_a_wheel_that_was_changed(site, python, tmp_path):
    folder = tmp_path / "site"
    (folder / "anyface").mkdir(parents=True)
    page = (site / "wheels/anyface/index.html").read_text()
    (folder / "anyface/index.html").write_text(page)
    wheel = next((site / "wheels/anyface").glob("*.whl"))
    (folder / "anyface" / wheel.name).write_bytes(wheel.read_bytes() + b"!")
    with served(folder) as address:
        pip = [python, "-m", "pip", "-q"]
        subprocess.run([*pip, "uninstall", "-y", "anyface"], check=True)
        install = [*pip, "install", "--no-cache-dir", "--index-url", address, "anyface"]
        done = subprocess.run(install, capture_output=True, text=True, check=False)
    assert done.returncode != 0 and "HASHES" in done.stderr, done.stderr
