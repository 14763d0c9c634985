"""`anyface bake`: one face of the open file, with the settings of its object and the options."""

import argparse
import os

import bpy

from ..core import emotion, look, systems
from ..core.errors import AnyfaceError, plain
from ..core.take import EMOTION_WORDS, Basis
from ..scene import bake, stale
from ..scene.sound import decode
from ..ui import character, preferences, running
from ..ui.settings import from_object
from . import telling


def run(options: argparse.Namespace) -> dict:
    """Animates the face; returns message and numbers for the report."""
    scene = named(bpy.data.scenes, options.scene, "scene") if options.scene else None
    scene = scene or bpy.context.scene
    ob = named(bpy.data.objects, options.object, "object")
    along = character.take_along(ob)
    settings = _settings(ob, scene, options)
    models = options.weights or preferences.model_folder(scene)
    engine = running.engine(settings.system, models)
    snapshot = bake.read(ob, scene, settings, engine)
    take = telling.work(snapshot, quiet=getattr(options, "quiet", True))
    try:
        text = bake.write(ob, snapshot, take)
    except BaseException:
        bake.discard(take)
        raise
    bake.settle(take)
    text = " ".join([text, *(f"({note})" for note in character.told(along))])
    if ob.library is None:
        ob.anyface.report, ob.anyface.report_is_error = text, False
    old = stale.everywhere()
    text = " ".join([text, *(f"({note})" for note in old)])
    fields = {"message": text, **_numbers(take), **({"stale_caches": old} if old else {})}
    # Rows of a batch have no `report` option, because every shot of a batch has a report.
    if getattr(options, "report", True):
        fields["look"] = _look(snapshot, take)
    return fields


def _look(snapshot, take) -> dict:
    """The `look` of a report, for the page of a batch; an error here does not fail the shot."""
    try:
        sound = snapshot.source.load(decode.decoder(snapshot.engine))
        return look.of_take(snapshot.face, sound, take)
    except Exception as raised:
        return {"warnings": [f"no picture of it could be made: {plain(raised)}"]}


def _numbers(take) -> dict:
    numbers = {"frames": take.frame_count, "largest_mm": round(take.largest_mm, 4)}
    if isinstance(take.motion, Basis):
        motion = take.motion
        numbers |= {"keys": len(motion.vectors), "error_mm": round(motion.error_mm, 4)}
    return numbers


def _settings(ob, scene, options) -> bake.Settings:
    settings = from_object(ob, scene)
    if options.strip is not None or options.audio is not None:
        settings.strips, settings.channel, settings.text = [], 0, ""
    if options.strip is not None:
        settings.strip, settings.sound_file = options.strip, ""
    if options.audio is not None:
        settings.strip, settings.sound_file = "", os.path.abspath(options.audio)
        settings.start_frame = scene.frame_start
    if options.emotion is not None:
        _set_emotion(settings, options.emotion)
    values = {
        "start_frame": options.start,
        "mode": options.mode,
        "error_mm": options.error,
        "fps": options.fps,
        "system": options.system,
        "axes": options.axes,
        "landmark_file": os.path.abspath(options.landmarks) if options.landmarks else None,
        "emotion_file": os.path.abspath(options.emotion_of) if options.emotion_of else None,
        "text": _text(options),
        "event_file": os.path.abspath(options.events) if options.events else None,
    }
    for name, value in values.items():
        if value is not None:
            setattr(settings, name, value)
    for field in systems.plain_fields():
        value = getattr(options, field.name)
        if value is not None:
            is_file = field.kind in systems.PATHS
            settings.fields[field.name] = os.path.abspath(value) if is_file else value
    settings.fixed_controls = {
        control.name: control.number(value)
        for control in systems.controls()
        if (value := getattr(options, control.name)) is not None
    }
    return settings


def _text(options) -> str | None:
    """The words that are spoken; None if neither option gives them."""
    if options.text_file is None:
        return options.text
    try:
        with open(options.text_file, encoding="utf-8-sig") as file:
            return file.read().strip()
    except (OSError, UnicodeDecodeError) as error:
        message = f"--text-file {options.text_file}: expected a text in UTF-8: {error}"
        raise AnyfaceError("input", message) from error


def _set_emotion(settings: bake.Settings, text: str) -> None:
    if text in EMOTION_WORDS:
        settings.emotion_source = EMOTION_WORDS[text]
        return
    settings.emotion_source, settings.blend = "GIVEN", emotion.parse(text)


def named(collection, name: str, what: str):
    """An item of `collection`; raises `AnyfaceError("input")`, which lists the names that fit."""
    match = collection.get(name)
    if match is None:
        fitting = [item.name for item in collection if getattr(item, "type", "MESH") == "MESH"]
        known = ", ".join(fitting) or "none"
        raise AnyfaceError("input", f"{what}: expected one of {known}, got {name!r}")
    return match
