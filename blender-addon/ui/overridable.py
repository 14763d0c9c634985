"""Groups of settings on objects that a library override can change."""

import bpy
from bpy.props import PointerProperty


def add(name: str, *groups) -> None:
    """Registers `groups`; the last of them, which holds the others, becomes `Object.name`."""
    for group in groups:
        bpy.utils.register_class(_overridable(group))
    kind = PointerProperty(type=groups[-1], override=_override("PointerProperty"))
    setattr(bpy.types.Object, name, kind)


def remove(name: str, *groups) -> None:
    """Unregisters them; values stay in the file."""
    delattr(bpy.types.Object, name)
    for group in reversed(groups):
        bpy.utils.unregister_class(group)


def _overridable(group):
    """Lets overrides of linked objects have their own values of all properties of a group.

    Computed properties have none.
    """
    for prop in group.__annotations__.values():
        if "get" not in prop.keywords:
            prop.keywords["override"] = _override(prop.function.__name__)
    return group


def _override(function: str) -> set[str]:
    """The argument `override` of a property that the function of that name makes."""
    more = {"USE_INSERTION"} if function == "CollectionProperty" else set()
    return {"LIBRARY_OVERRIDABLE", *more}
