"""The pictures of emotions for each face, as items to choose from."""

from dataclasses import dataclass
from pathlib import Path

import bpy.utils.previews
from bpy.app.handlers import persistent

from ..core.emotion import EMOTIONS
from ..core.portraits import path_of
from ..scene import identity


@dataclass
class Shown:
    """The folder of a face's pictures, and the intensity at which they were drawn."""

    folder: Path
    intensity: float


# The key is the object's number, which is valid while the file is open, or else its name.
_shown: dict[int | str, Shown] = {}
# Items by folder. They are kept here because Blender does not keep the texts of items itself.
_items: dict[Path | None, list[tuple]] = {}
_previews = None


def of(ob) -> Shown | None:
    """The pictures for `ob`; None if none were drawn since the file was opened."""
    return _shown.get(_key(ob))


def show(ob, folder: Path, intensity: float) -> None:
    """Shows the pictures of `folder` for `ob` from now on."""
    if folder not in _items:
        _items[folder] = _made(folder)
    _shown[_key(ob)] = Shown(folder, intensity)


def items(settings, _context) -> list[tuple]:
    """The emotions as items of an enum, with the pictures of the face of `settings`."""
    shown = of(settings.id_data)
    folder = shown.folder if shown is not None else None
    if folder not in _items:
        _items[folder] = _made(folder)
    return _items[folder]


def _made(folder: Path | None) -> list[tuple]:
    icons = [_icon(folder, name) if folder is not None else 0 for name in EMOTIONS]
    pairs = enumerate(zip(EMOTIONS, icons, strict=True))
    return [(name, name.capitalize(), "", icon, number) for number, (name, icon) in pairs]


def _icon(folder: Path, emotion: str) -> int:
    path = path_of(folder, emotion)
    return _previews.load(f"{folder.name} {emotion}", str(path), "IMAGE").icon_id


def chosen(settings) -> int:
    """The number of the emotion."""
    return EMOTIONS.index(settings.emotion)


def choose(settings, number: int) -> None:
    """Sets the emotion by its number."""
    settings.emotion = EMOTIONS[number]


def _key(ob) -> int | str:
    return identity.number(ob) or ob.name


@persistent
def _on_load(*_) -> None:
    _shown.clear()


def register() -> None:
    """Creates the collection of pictures."""
    global _previews
    _previews = bpy.utils.previews.new()
    bpy.app.handlers.load_pre.append(_on_load)


def unregister() -> None:
    """Frees the pictures."""
    global _previews
    bpy.app.handlers.load_pre.remove(_on_load)
    _shown.clear()
    _items.clear()
    bpy.utils.previews.remove(_previews)
    _previews = None
