"""Anyface for bpy from PyPI: the same as Blender's `--command anyface`, without Blender.

    python -m anyface_batch shot.blend bake --object Head --strip Voice --save out.blend
    python -m anyface_batch batch jobs.json --workers 4

Put the folder of this file on PYTHONPATH: the extension's folder once it is installed, or the
unpacked zip. The options are those of `core/options.py`; the word `bake` may be left out. Only
`batch` works without bpy, if `--blender` names the program that does the shots.
"""

import importlib
import importlib.util
import os
import sys
import types
from pathlib import Path

_FOLDER = Path(__file__).resolve().parent
_PACKAGE = "anyface_extension"
_BARE = "anyface_without_blender"


def main(arguments: list[str] | None = None) -> int:
    """Runs the command, returns its exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments[:1] == ["batch"] and "bpy" not in sys.modules:
        return _batch(arguments)
    extension = load_extension()
    return importlib.import_module(f"{extension.__name__}.command").main(ordered(arguments))


def ordered(arguments: list[str]) -> list[str]:
    """The arguments with the task first: `shot.blend bake …` becomes `bake --file shot.blend …`."""
    file = [word for word in arguments[:2] if word.endswith(".blend")][:1]
    rest = [word for word in arguments[:2] if word not in file] + arguments[2:]
    task = "bake" if file and rest[:1] and rest[0].startswith("-") else None
    words = [task, *rest] if task else rest
    return [words[0], "--file", file[0], *words[1:]] if file and words else words


def _batch(arguments: list[str]) -> int:
    """Runs `batch`, which only distributes shots.

    Imports the package around this file without the modules that need bpy.
    """
    package = types.ModuleType(_BARE)
    package.__path__ = [str(_FOLDER)]
    sys.modules.setdefault(_BARE, package)
    options = importlib.import_module(f"{_BARE}.core.options").parser("anyface_batch")
    try:
        parsed = options.parse_args(arguments)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 2
    return importlib.import_module(f"{_BARE}.farm.batch").run(parsed)


def load_extension():
    """Imports the package around this file and registers its settings with Blender."""
    import bpy

    if _PACKAGE not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            _PACKAGE, _FOLDER / "__init__.py", submodule_search_locations=[str(_FOLDER)]
        )
        module = importlib.util.module_from_spec(spec)
        sys.modules[_PACKAGE] = module
        spec.loader.exec_module(module)
        if not hasattr(bpy.types.Object, "anyface"):
            importlib.import_module(f"{_PACKAGE}.ui.properties").register()
    return sys.modules[_PACKAGE]


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # bpy 4.2 crashes and bpy 4.5 hangs while Python ends with an add-on's properties registered.
    os._exit(code)
