"""The rules of extensions.blender.org for add-ons, in the order of docs/publishing.md."""

import ast
import importlib.util
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from conftest import ROOT

SOURCES = sorted((ROOT / "blender-addon").rglob("*.py"))
# Modules that come with Blender.
BLENDERS = {
    "aud", "bmesh", "bpy", "bpy_extras", "gpu", "gpu_extras", "mathutils", "numpy", "pxr",
    "zstandard",
}  # fmt: skip
# Modules that only a Python outside of Blender needs, when it distributes a batch.
OUTSIDE = {"farm/cluster.py": {"cloudpickle", "distributed"}}
# Modules of Python with which a program can reach other machines.
ONLINE = {"asyncio", "ftplib", "http", "smtplib", "ssl", "urllib", "webbrowser", "xmlrpc"}
LARGEST_BYTES = 200_000_000
LIBRARIES = {
    "libanyface.so", "libanyface.dylib", "anyface.dll",
    "libanyface_microphone.so", "libanyface_microphone.dylib", "anyface_microphone.dll",
}  # fmt: skip


@pytest.fixture(scope="module")
def archive(extension):
    """The opened zip."""
    with zipfile.ZipFile(extension) as file:
        yield file


@pytest.fixture(scope="module")
def manifest():
    """The manifest of the sources."""
    return tomllib.loads((ROOT / "blender-addon/blender_manifest.toml").read_text())


def name(path):
    """A source's name within the extension."""
    return path.relative_to(ROOT / "blender-addon").as_posix()


def trees():
    """The sources as Python sees them, by name."""
    return {name(path): ast.parse(path.read_text()) for path in SOURCES}


def test_blender_finds_no_fault_in_the_zip(extension):
    bpy = Path(importlib.util.find_spec("bpy").origin).parent
    (tool,) = bpy.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    tags = tool.parents[3] / "modules/_bpy_internal/extensions/tags.py"
    command = [sys.executable, tool, "validate", f"--valid-tags={tags}", extension]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "warning" not in (done.stdout + done.stderr).lower()


def test_the_manifest_says_what_it_is_in_the_form_that_is_asked_for(manifest):
    assert "blender" not in manifest["name"].lower()
    sentences = [manifest["tagline"], *manifest["permissions"].values()]
    for sentence in sentences:
        assert len(sentence) <= 64 and sentence[-1].isalnum(), sentence
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text())
    assert manifest["version"] == cargo["workspace"]["package"]["version"]


def test_the_manifest_credits_whose_work_is_inside(manifest):
    notice = (ROOT / "NOTICE").read_text()
    holders = [re.fullmatch(r"\d{4}(-\d{4})? (.+)", line)[2] for line in manifest["copyright"]]
    for holder in holders:
        assert "THIRD-PARTY.md" in holder or holder in notice, holder
    assert {"The Anyface authors", "Princeton University", "OpenAI"} <= set(holders)


def test_the_manifest_asks_for_no_more_than_the_code_takes(manifest):
    assert set(manifest["permissions"]) == {"files", "microphone", "network"}
    names = {alias for tree in trees().values() for alias in imported(tree)}
    # Only Dask uses the network. Without Dask there would be nothing to ask permission for.
    assert "distributed" in names


def test_the_zip_holds_sources_and_the_libraries_of_one_system(archive):
    names = archive.namelist()
    addon_manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert len(addon_manifest["platforms"]) == 1
    libraries = {item.removeprefix("lib/") for item in names if item.startswith("lib/")} - {""}
    assert libraries and libraries <= LIBRARIES
    endings = {"", ".json", ".md", ".npz", ".py", ".toml", ".txt"}
    # Templates that are filled in for other programs. Blender runs none of them.
    templates = {".html", ".js", ".json", ".py", ".sh", ".yaml"}
    others = [item for item in names if not item.startswith("lib/") and not item.endswith("/")]
    for item in others:
        known = templates if item.startswith("farm/engines/") else endings
        assert Path(item).suffix in known, item
    assert not [item for item in names if "__pycache__" in item or "/." in f"/{item}"]
    assert {"LICENSE", "licences/NOTICE", "licences/THIRD-PARTY.md"} <= set(names)


def test_the_zip_is_small_enough_to_upload(extension):
    assert extension.stat().st_size < LARGEST_BYTES


def imported(tree):
    """Top-level names of the modules that a source imports by absolute name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.partition(".")[0]


def test_modules_are_its_own_by_relative_names_or_those_of_blender():
    for path, tree in trees().items():
        # Only this file may use the module name by which the extension starts without Blender.
        start_modules = {"anyface_batch"} if path == "anyface_batch.py" else set()
        known = BLENDERS | sys.stdlib_module_names | OUTSIDE.get(path, set()) | start_modules
        assert not set(imported(tree)) - known, path
        assert not ONLINE & set(imported(tree)), path


def used(tree):
    """Names and attributes in full, such as `sys.path`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute | ast.Name):
            yield ast.unparse(node)


def test_it_leaves_other_add_ons_and_the_search_for_modules_alone():
    for path, tree in trees().items():
        names = set(used(tree))
        assert not names & {"sys.path", "sys.meta_path", "bl_info", "site.addsitedir"}, path
        modules = {item for item in names if item.startswith("sys.modules")}
        assert path == "anyface_batch.py" or not modules, path
        changing = ("bpy.ops.extensions", "bpy.ops.preferences", "addon_utils")
        assert not [item for item in names if item.startswith(changing)], path


def test_it_runs_no_text_as_code_and_starts_nothing_but_blender():
    for path, tree in trees().items():
        calls = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
        assert not calls & {"eval", "exec", "compile", "__import__", "os.system"}, path
        sockets = {call for call in calls if call.startswith("socket.")}
        assert sockets <= {"socket.gethostname"}, path
        assert path == "farm/attempt.py" or "subprocess" not in set(imported(tree)), path
