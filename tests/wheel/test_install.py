"""The content of the wheel, and its installation into an environment with only numpy."""

import base64
import csv
import hashlib
import io
import re
import shutil
import subprocess
import sys
import venv
import zipfile

import pytest

from conftest import HEAD, ROOT


def test_its_list_names_every_file_with_its_digest(wheel):
    archive = zipfile.ZipFile(wheel)
    name = next(name for name in archive.namelist() if name.endswith("/RECORD"))
    rows = list(csv.reader(io.TextIOWrapper(archive.open(name))))
    assert {row[0] for row in rows} == set(archive.namelist())
    for path, digest, size in rows:
        if path == name:
            continue
        content = archive.read(path)
        actual_digest = (
            base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        )
        assert (digest, int(size)) == (f"sha256={actual_digest}", len(content)), path


def test_its_core_is_that_of_the_extension(wheel):
    archive = zipfile.ZipFile(wheel)
    names = [name for name in archive.namelist() if name.startswith("anyface/core/")]
    assert "anyface/core/native.py" in names
    for name in names:
        source = ROOT / "blender-addon" / name.removeprefix("anyface/")
        assert archive.read(name) == source.read_bytes(), name
        assert b"bpy." not in archive.read(name), name


def test_it_carries_the_licences_of_what_is_linked(wheel):
    archive = zipfile.ZipFile(wheel)
    name = next(name for name in archive.namelist() if name.endswith("/METADATA"))
    folder = name.rpartition("/")[0]
    head = archive.read(name).decode().partition("\n\n")[0]
    files = re.findall(r"^License-File: (.+)$", head, flags=re.MULTILINE)
    assert "THIRD-PARTY.md" in files
    inside = {name for name in archive.namelist() if name.startswith(f"{folder}/licenses/")}
    assert inside == {f"{folder}/licenses/{name}" for name in files}
    for name in files:
        assert archive.read(f"{folder}/licenses/{name}") == (ROOT / name).read_bytes(), name


@pytest.mark.skipif(not shutil.which("objdump"), reason="needs objdump")
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no glibc")
def test_its_tag_is_the_glibc_that_its_library_needs(wheel, tmp_path):
    library = zipfile.ZipFile(wheel).extract("anyface/lib/libanyface.so", tmp_path)
    table = subprocess.run(["objdump", "-T", library], capture_output=True, text=True, check=True)
    versions = re.findall(r"GLIBC_(\d+)\.(\d+)", table.stdout)
    newest = max((int(major), int(minor)) for major, minor in versions)
    tag = re.search(r"-py3-none-manylinux_(\d+)_(\d+)_x86_64\.whl$", wheel.name)
    assert (int(tag[1]), int(tag[2])) == newest


def test_the_script_of_the_page_runs_where_there_is_only_numpy(wheel, voice, tmp_path):
    page = (ROOT / "docs/python.md").read_text()
    script = re.search(r"```python\n(.*?)```", page, flags=re.DOTALL)[1]
    assert len(script.strip().splitlines()) <= 10
    venv.create(tmp_path / "clean", with_pip=True)
    python = tmp_path / "clean" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    subprocess.run([python, "-m", "pip", "install", "-q", wheel], check=True)
    listed = [python, "-m", "pip", "list", "--format=freeze"]
    packages = subprocess.run(listed, capture_output=True, text=True, check=True).stdout
    names = {line.split("==")[0] for line in packages.split()}
    assert names - {"pip", "setuptools", "wheel"} == {"anyface", "numpy"}
    shutil.copy(HEAD, tmp_path / "head.obj")
    shutil.copy(voice, tmp_path / "voice.wav")
    (tmp_path / "script.py").write_text(script)
    ran = subprocess.run([python, "-I", "script.py"], cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "talk.npz").stat().st_size > 1e6
