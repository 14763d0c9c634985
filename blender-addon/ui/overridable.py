"""Groups of settings on objects, which a library override may have for itself."""

import bpy
from bpy.props import PointerProperty


def add(name: str, *groups) -> None:
    """Registers `groups`; the last of them, which holds the others, becomes `Object.name`."""
    for group in groups:
        bpy.utils.register_class(_overridable(group))
    kind = PointerProperty(type=groups[-1], override=_override("PointerProperty"))
    setattr(bpy.types.Object, name, kind)


def remove(name: str, *groups) -> None:
    """Takes them away; values stay in the file."""
    delattr(bpy.types.Object, name)
    for group in reversed(groups):
        bpy.utils.unregister_class(group)


def _overridable(group):
    """Lets overrides of linked objects keep their own values of all properties of a group.

    Properties that are computed have none.
    """
    for prop in group.__annotations__.values():
        if "get" not in prop.keywords:
            prop.keywords["override"] = _override(prop.function.__name__)
    return group


def _override(function: str) -> set[str]:
    """What `override` is for a property made by the function of that name."""
    more = {"USE_INSERTION"} if function == "CollectionProperty" else set()
    return {"LIBRARY_OVERRIDABLE", *more}
