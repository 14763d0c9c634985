"""Settings that a library override may have for itself."""


def overridable(cls):
    """Lets overrides of linked objects keep their own values of all properties of a group.

    Properties that are computed have none.
    """
    for prop in cls.__annotations__.values():
        if "get" not in prop.keywords:
            prop.keywords["override"] = kinds(prop.function.__name__)
    return cls


def kinds(function: str = "PointerProperty") -> set[str]:
    """What `override` is for a property made by the function of that name."""
    more = {"USE_INSERTION"} if function == "CollectionProperty" else set()
    return {"LIBRARY_OVERRIDABLE", *more}
