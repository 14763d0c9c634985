"""Registers groups of object settings so that a library override can change them."""

import bpy
from bpy.props import PointerProperty


def add(name: str, *groups) -> None:
    """Registers `groups`; the last of them, which holds the others, becomes `Object.name`."""
    for group in groups:
        bpy.utils.register_class(_overridable(group))
    kind = PointerProperty(type=groups[-1], override=_override("PointerProperty"))
    setattr(bpy.types.Object, name, kind)


def remove(name: str, *groups) -> None:
    """Unregisters the groups; values stay in the file."""
    delattr(bpy.types.Object, name)
    for group in reversed(groups):
        bpy.utils.unregister_class(group)


def _overridable(group):
    """Lets an override of a linked object have its own value of each property in a group.

    Computed properties are left as they are: they store no value.
    """
    for prop in group.__annotations__.values():
        if "get" not in prop.keywords:
            prop.keywords["override"] = _override(prop.function.__name__)
    return group


def _override(function: str) -> set[str]:
    """The argument `override` for a property made by `function`, such as "IntProperty"."""
    more = {"USE_INSERTION"} if function == "CollectionProperty" else set()
    return {"LIBRARY_OVERRIDABLE", *more}
