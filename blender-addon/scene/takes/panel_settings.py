"""The panel's settings of a character as plain values, stored with each take."""

from ...core.heard_emotion import HeardEmotion
from .. import outputs
from ..shape_keys import record

# The stored property groups of an object. The output's group is not stored, since setting its
# sliders would change a finished take.
GROUPS = ("anyface", "anyface_audio", "anyface_life_settings")
_REPORT, _LAST, _DETAILS = "report", "last_frame", "report_details"
# Properties that show another setting in a different form.
_SHOWN = ("emotion_face",)
_KINDS = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}


def read(ob) -> dict:
    """The settings by group and name, and the names of the chosen strips."""
    values = {name: _values(getattr(ob, name)) for name in GROUPS}
    values["chosen"] = [row.name for row in ob.anyface_audio.chosen]
    return values


def note(ob, settings: dict, report: str, heard_emotion: HeardEmotion | None = None) -> None:
    """Stores settings and results with the take that plays on `ob`.

    The results are the report, its details, the last frame, and the emotion heard in the voice.
    """
    take_record = record.read(ob.data.shape_keys) if outputs.has_take(ob) else None
    if take_record is not None:
        take_record.asked = {
            **settings,
            _REPORT: report,
            _LAST: ob.anyface.last_frame,
            _DETAILS: ob.anyface.report_details,
        }
        if heard_emotion is not None:
            take_record.heard_emotion = heard_emotion.to_plain()
        record.write(ob.data.shape_keys, take_record)


def bring_back(ob) -> None:
    """Sets the panel to the settings of the playing take; animation of the settings stays."""
    take_record = record.read(ob.data.shape_keys)
    settings = take_record.asked if take_record is not None else {}
    if "emotion" in _object(settings, "anyface"):
        # Takes of earlier versions have a single emotion, not a mixture.
        ob.anyface.mixed = ""
    for name in GROUPS:
        _set(getattr(ob, name), _object(settings, name))
    chosen = settings.get("chosen")
    if isinstance(chosen, list):
        ob.anyface_audio.chosen.clear()
        for name in chosen:
            ob.anyface_audio.chosen.add().name = str(name)
    if _REPORT in settings:
        ob.anyface.report_is_error = False
    said = {_REPORT: settings.get(_REPORT, ob.anyface.report), _LAST: settings.get(_LAST, 0)}
    _set(ob.anyface, said | {_DETAILS: settings.get(_DETAILS, "")})


def _values(group) -> dict:
    names = [p.identifier for p in group.bl_rna.properties if p.type in _KINDS]
    writable = [name for name in names if not group.is_property_readonly(name)]
    return {
        name: getattr(group, name)
        for name in writable
        if name not in ("name", _REPORT, _LAST, _DETAILS, *_SHOWN)
    }


def _object(settings: dict, name: str) -> dict:
    """The object of this name in stored settings; empty if somebody stored something else."""
    found = settings.get(name)
    return found if isinstance(found, dict) else {}


def _set(group, values: dict) -> None:
    for name, value in values.items():
        # The take may come from another version, with other settings or choices.
        try:
            setattr(group, name, value)
        except (AttributeError, TypeError, ValueError, OverflowError):
            continue
