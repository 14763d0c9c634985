"""Draws the emotion that was heard in a take as a picture in the panel."""

import bpy.utils.previews
import numpy as np
from bpy.app.handlers import persistent

from ..core import plot
from ..core.heard_emotion import HeardEmotion
from ..scene.shape_keys import record

# The height of the picture in lines of the panel.
_LINES = 7.0
# The most pictures in memory. Before one more is drawn, all are dropped.
_MOST = 24
_GREY = (0.62, 0.62, 0.62)
_COLOURS = {
    "neutral": _GREY,
    "happy": (0.98, 0.80, 0.25),
    "pleased": (0.85, 0.88, 0.35),
    "calm": (0.45, 0.80, 0.55),
    "surprised": (0.95, 0.60, 0.85),
    "sad": (0.35, 0.55, 0.95),
    "afraid": (0.70, 0.50, 0.95),
    "angry": (0.95, 0.35, 0.28),
    "disgusted": (0.50, 0.72, 0.20),
}
_previews = None
# The emotion that was heard in each take, by the take's id. It never changes.
_heard: dict[str, HeardEmotion | None] = {}


def heard(ob) -> tuple[str, HeardEmotion] | None:
    """The id of the take that plays on `ob`, and the emotion that was heard in it; or None."""
    shape_keys = ob.data.shape_keys if ob is not None and ob.type == "MESH" else None
    take_record = record.read(shape_keys)
    if take_record is None or not take_record.heard_emotion:
        return None
    if take_record.id not in _heard:
        _heard[take_record.id] = HeardEmotion.of_plain(take_record.heard_emotion)
    emotion = _heard[take_record.id]
    return None if emotion is None else (take_record.id, emotion)


def draw(layout, ob) -> None:
    """Draws the picture and the meaning of its colours; nothing if no emotion was heard."""
    take_and_emotion = heard(ob)
    if take_and_emotion is None:
        return
    take_id, emotion = take_and_emotion
    column = layout.column(align=True)
    column.label(text="Heard in the Voice", icon="SOUND")
    column.template_icon(icon_value=icon(take_id, emotion), scale=_LINES)
    for name, most, second in emotion.likely():
        text = f"{name.capitalize()}, up to {most:.2f}, at {second:.1f} s"
        column.label(text=text, icon_value=_swatch(name))
    shown = max(emotion.intensity)
    column.label(text=f"The face shows up to {100.0 * shown:.0f} % of it")


def icon(take_id: str, emotion: HeardEmotion) -> int:
    """The icon of a take's picture. The picture is drawn when it is first needed."""
    name = f"take {take_id}"
    if name not in _previews:
        if len(_previews) >= _MOST:
            _previews.clear()
        times = np.array(emotion.time_s)
        # The likeliest emotion is drawn last, on top; neutral is drawn first.
        names = [name for name, *_ in reversed(emotion.likely())]
        names.sort(key=lambda name: name != "neutral")
        curves = [
            (np.array(emotion.probability[name]), _COLOURS.get(name, _GREY)) for name in names
        ]
        _put(name, plot.draw(times, curves))
    return _previews[name].icon_id


def _swatch(emotion: str) -> int:
    name = f"colour of {emotion}"
    if name not in _previews:
        _put(name, plot.swatch(_COLOURS.get(emotion, _GREY)))
    return _previews[name].icon_id


def _put(name: str, pixels: np.ndarray) -> None:
    preview = _previews.new(name)
    upright = np.ascontiguousarray(pixels[::-1])
    for kind in ("image", "icon"):
        setattr(preview, f"{kind}_size", pixels.shape[:2])
        numbers = (upright.astype(np.float32) / 255.0).ravel()
        getattr(preview, f"{kind}_pixels_float").foreach_set(numbers)


@persistent
def _on_load(*_) -> None:
    _heard.clear()
    _previews.clear()


def register() -> None:
    """Creates the collection of pictures."""
    global _previews
    _previews = bpy.utils.previews.new()
    bpy.app.handlers.load_pre.append(_on_load)


def unregister() -> None:
    """Frees the pictures."""
    global _previews
    bpy.app.handlers.load_pre.remove(_on_load)
    _heard.clear()
    bpy.utils.previews.remove(_previews)
    _previews = None
