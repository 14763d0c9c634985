"""Anyface for bpy from PyPI: the same as Blender's `--command anyface`, without Blender.

    python -m anyface_batch shot.blend bake --object Head --strip Voice --save out.blend

Put the folder of this file on PYTHONPATH: the extension's folder once it is installed, or the
unpacked zip. The options are those of `ui/command.py`; the word `bake` may be left out.
"""

import argparse
import importlib.util
import os
import sys
from pathlib import Path

_FOLDER = Path(__file__).resolve().parent
_PACKAGE = "anyface_extension"


def main(arguments: list[str] | None = None) -> int:
    """Opens the file, runs the command, returns its exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    import bpy

    extension = load_extension()
    command = importlib.import_module(f"{extension.__name__}.ui.command")
    if "bake" in arguments[:2]:
        arguments.remove("bake")
    parser = argparse.ArgumentParser(
        prog="python -m anyface_batch", description="Animates one face of a .blend file."
    )
    parser.add_argument("blend", help="the .blend file to open")
    command.add_bake_options(parser)
    try:
        options = parser.parse_args(arguments)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 2
    try:
        bpy.ops.wm.open_mainfile(filepath=os.path.abspath(options.blend))
    except RuntimeError as error:
        print(f"anyface: {str(error).strip()}", file=sys.stderr)
        return 8
    return command.run(options)


def load_extension():
    """The package around this file, with its settings known to Blender."""
    import bpy

    if _PACKAGE not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            _PACKAGE, _FOLDER / "__init__.py", submodule_search_locations=[str(_FOLDER)]
        )
        module = importlib.util.module_from_spec(spec)
        sys.modules[_PACKAGE] = module
        spec.loader.exec_module(module)
        if not hasattr(bpy.types.Object, "anyface"):
            importlib.import_module(f"{_PACKAGE}.ui.properties").register_character()
    return sys.modules[_PACKAGE]


if __name__ == "__main__":
    sys.exit(main())
