"""Names that modules of the package import from each other exist, even if a library is missing."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = sorted(path for path in (ROOT / "training").rglob("*.py"))


def defined(path: Path) -> set[str]:
    """Names at the top of a module."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names.update((alias.asname or alias.name).split(".")[0] for alias in node.names)
    return names


def offers(module: str, name: str) -> bool:
    """Whether `from module import name` finds it."""
    place = ROOT.joinpath(*module.split("."))
    if (place / f"{name}.py").exists() or (place / name / "__init__.py").exists():
        return True
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    return path.exists() and name in defined(path)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imported_names_exist(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("training"):
            for alias in node.names:
                assert offers(node.module, alias.name), f"{node.module} has no {alias.name}"


def test_no_module_imports_itself_through_others():
    names = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in MODULES}
    graph = {}
    for name, path in names.items():
        imports = [
            n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom) and n.module
        ]
        imported = {f"{n.module}.{alias.name}" for n in imports for alias in n.names} | {
            n.module for n in imports
        }
        graph[name] = imported & names.keys()
    TopologicalSorter(graph).prepare()
