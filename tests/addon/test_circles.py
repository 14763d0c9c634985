"""No Python file of the extension imports itself through other files."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest


def imported_files(path: Path, root: Path) -> set[Path]:
    """The files of the package at `root` that the file `path` imports, inside functions too.

    Python runs the `__init__.py` of every package on the way. Those of the packages around `path`
    are running already, so they are left out.
    """
    files = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        folder = path.parents[node.level - 1]
        assert folder.is_relative_to(root), f"{path}, line {node.lineno} leaves the extension"
        for part in node.module.split(".") if node.module else ():
            folder = folder / part
            files.add(folder.with_suffix(".py") if not folder.is_dir() else folder / "__init__.py")
        for alias in node.names if folder.is_dir() else ():
            inner = folder / alias.name
            files |= {inner.with_suffix(".py"), inner / "__init__.py"}
            files.add(folder / "__init__.py")
    around = {parent / "__init__.py" for parent in path.parents}
    return {other for other in files if other.is_file() and other != path} - around


def circle(root: Path) -> list[str]:
    """The files of one circle of imports, in order. Empty if there is no circle."""
    graph = {path: imported_files(path, root) for path in root.rglob("*.py")}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return [path.relative_to(root).as_posix() for path in error.args[1]]
    return []


def test_no_file_imports_itself_through_others(installed):
    assert circle(installed) == []
    graph = {path: imported_files(path, installed) for path in installed.rglob("*.py")}
    assert sum(map(len, graph.values())) > 400


@pytest.mark.parametrize("line", ["from .b import b", "from . import b", "from ..room.b import b"])
def test_a_circle_is_found_that_a_function_hides(tmp_path, line):
    room = tmp_path / "room"
    room.mkdir()
    for path in (tmp_path / "__init__.py", room / "__init__.py"):
        path.write_text("")
    (room / "a.py").write_text(f"def a():\n    {line}\n    return b\n")
    (room / "b.py").write_text("b = 1\n")
    assert circle(tmp_path) == []
    (room / "b.py").write_text("from .a import a\nb = 1\n")
    assert sorted(set(circle(tmp_path))) == ["room/a.py", "room/b.py"]
