"""Writes the details of a fault into a text of the file, since few artists see a console."""

import platform

import bpy

from ..core.errors import AnyfaceError, details

NAME = "Anyface Fault"


def save(error: AnyfaceError) -> AnyfaceError:
    """Writes the details of a fault into a text; returns the error with the name of the text.

    Errors without details are returned as they are.
    """
    report = details(error)
    if not report:
        return error
    text = bpy.data.texts.get(NAME) or bpy.data.texts.new(NAME)
    text.clear()
    blender = f"Blender {bpy.app.version_string}, {platform.platform()}"
    text.write(f"{error}\n\n{blender}\n\n{report}")
    more = AnyfaceError(error.kind, f"{error} (or the text {NAME} in the Text Editor)", error.mends)
    more.__cause__ = error.__cause__
    return more
