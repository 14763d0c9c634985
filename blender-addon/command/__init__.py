"""The command without a window: `blender -b --command anyface bake --file shot.blend …`.

Exit codes are those of `core.errors`; 2 is wrong usage, 0 a written file.
"""

import argparse
import sys

import bpy

from ..core import options as words
from ..core.errors import AnyfaceError, plain, say
from ..farm import batch
from ..scene import outputs
from . import run, shot

_HANDLE = None


def main(arguments: list[str]) -> int:
    """Runs the command on the open file, or on the one that it names; returns its exit code."""
    try:
        parser = words.parser("anyface", outputs.WORDS)
        try:
            options = parser.parse_args(arguments)
        except SystemExit as error:
            return error.code if isinstance(error.code, int) else 2
        return start(options)
    except BaseException as raised:
        error = plain(raised)
        say(f"anyface: {error}", sys.stderr)
        return error.exit_code


def start(options: argparse.Namespace) -> int:
    """Runs a parsed command."""
    if options.task == "batch":
        if options.scheduler and not bpy.app.online_access:
            raise AnyfaceError(
                "input",
                "--scheduler opens a connection, and Allow Online Access is off in Blender's "
                "preferences: turn it on, start Blender with --online-mode, or run "
                "`python anyface_batch.py batch …` without Blender",
            )
        return batch.run(options, bpy.app.binary_path)
    if options.task == "shot":
        return shot.main()
    return run.main(options)


def register() -> None:
    """Adds the command to Blender."""
    global _HANDLE
    _HANDLE = bpy.utils.register_cli_command("anyface", main)


def unregister() -> None:
    """Removes the command."""
    bpy.utils.unregister_cli_command(_HANDLE)
