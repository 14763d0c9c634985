"""The command: `blender -b shot.blend --command anyface bake --object Head --strip Voice …`.

Exit codes are those of `core.errors`; 2 is wrong usage, 0 a written file.
"""

import argparse
import json
import os
import sys
import time

import bpy

from ..core import emotion
from ..core.errors import AnyfaceError
from ..core.job import Progress
from ..scene import bake
from . import running
from .settings import from_object

_HANDLE = None


def main(arguments: list[str]) -> int:
    """Runs the command on the open file and returns its exit code."""
    try:
        options = parser("anyface").parse_args(arguments)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 2
    return run(options)


def parser(program: str) -> argparse.ArgumentParser:
    """The options, the same for the command and for `python -m anyface_batch`."""
    top = argparse.ArgumentParser(prog=program, description="Makes faces talk.")
    tasks = top.add_subparsers(dest="task", required=True)
    add_bake_options(tasks.add_parser("bake", help="animate one face and save the file"))
    return top


def add_bake_options(task: argparse.ArgumentParser) -> None:
    """Options that are left out take the values stored on the object."""
    task.add_argument("--object", required=True, help="name of the face's object")
    source = task.add_mutually_exclusive_group()
    source.add_argument("--strip", help="name of a sound strip")
    source.add_argument("--audio", metavar="FILE", help="a sound file")
    task.add_argument("--start", type=int, metavar="FRAME", help="first frame of --audio")
    task.add_argument("--scene", help="name of the scene (default: the active one)")
    task.add_argument("--emotion", metavar="NAME:X[,…]", help="such as happy:0.7; auto; off")
    task.add_argument("--mode", choices=bake.MODES)
    task.add_argument("--error", type=float, metavar="MM", help="largest error of basis keys")
    task.add_argument("--fps", type=float, help="default: the scene's")
    task.add_argument("--seed", type=int)
    task.add_argument("--steps", type=int, help="denoising steps")
    task.add_argument("--style", help="speaking style")
    task.add_argument("--axes", choices=("AUTO", "WORLD", "LOCAL", "LOCAL_Y_UP"))
    task.add_argument("--landmarks", metavar="FILE", help="JSON file with the 68 landmarks")
    task.add_argument("--save", required=True, metavar="FILE", help="the .blend to write")
    task.add_argument("--report", metavar="FILE", help="write what was done as JSON")


def run(options: argparse.Namespace) -> int:
    """Bakes with parsed options; prints one line, writes the report, returns the exit code."""
    began = time.monotonic()
    try:
        text = _bake(options)
        outcome = {"ok": True, "message": text, "file": os.path.abspath(options.save)}
        code = 0
    except AnyfaceError as error:
        outcome = {"ok": False, "kind": error.kind, "message": str(error)}
        code = error.exit_code
    outcome |= {"object": options.object, "exit_code": code}
    outcome["seconds"] = round(time.monotonic() - began, 3)
    stream = sys.stdout if code == 0 else sys.stderr
    print(f"anyface: {outcome['message']}", file=stream, flush=True)
    if options.report:
        with open(options.report, "w", encoding="utf-8") as file:
            json.dump(outcome, file, indent=1)
    return code


def _bake(options) -> str:
    scene = _named(bpy.data.scenes, options.scene, "scene") if options.scene else None
    scene = scene or bpy.context.scene
    ob = _named(bpy.data.objects, options.object, "object")
    settings = _settings(ob, options)
    snapshot = bake.read(ob, scene, settings, running.engine())
    take = snapshot.work(Progress())
    text = bake.write(ob, snapshot, take)
    if ob.library is None:
        ob.anyface.report, ob.anyface.report_is_error = text, False
    _save(options.save)
    return text


def _settings(ob, options) -> bake.Settings:
    settings = from_object(ob)
    if options.strip is not None:
        settings.strip, settings.sound_file = options.strip, ""
    if options.audio is not None:
        settings.strip, settings.sound_file = "", os.path.abspath(options.audio)
        settings.start_frame = bpy.context.scene.frame_start
    if options.emotion is not None:
        _set_emotion(settings, options.emotion)
    given = {
        "start_frame": options.start,
        "mode": options.mode,
        "error_mm": options.error,
        "fps": options.fps,
        "seed": options.seed,
        "steps": options.steps,
        "style": options.style,
        "axes": options.axes,
        "landmark_file": os.path.abspath(options.landmarks) if options.landmarks else None,
    }
    for name, value in given.items():
        if value is not None:
            setattr(settings, name, value)
    return settings


def _set_emotion(settings: bake.Settings, text: str) -> None:
    if text in ("auto", "off"):
        settings.emotion_source = "VOICE" if text == "auto" else "OFF"
        return
    settings.emotion_source, settings.blend = "GIVEN", emotion.parse(text)


def _named(collection, name: str, what: str):
    found = collection.get(name)
    if found is None:
        known = ", ".join(item.name for item in collection) or "none"
        raise AnyfaceError("input", f"{what}: expected one of {known}, got {name!r}")
    return found


def _save(path: str) -> None:
    try:
        bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(path), check_existing=False)
    except RuntimeError as error:
        raise AnyfaceError("file", f"{path}: {str(error).strip()}") from error


def register() -> None:
    """Adds the command to Blender."""
    global _HANDLE
    _HANDLE = bpy.utils.register_cli_command("anyface", main)


def unregister() -> None:
    """Takes it away."""
    bpy.utils.unregister_cli_command(_HANDLE)
