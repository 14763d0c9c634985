"""Replaces the artist's action for a while by a copy that lacks some of its curves."""

from . import curves, digest


def play(holder, name: str, animation, paths: set[str]) -> str:
    """Plays a copy of the action without the curves `paths`; keeps the original in `holder[name]`.

    Returns the digest of the copy, or "" if the action has none of these curves.
    """
    original = animation.action if animation is not None else None
    if original is None or not any(curves.find_any(animation, path) for path in paths):
        return ""
    holder[name] = original
    animation.action = original.copy()
    curves.remove(animation, paths)
    return digest.action_digest(animation.action)


def give_back(original, animation, paths: set[str], print_before: str) -> None:
    """Plays the original again.

    If the artist has edited the copy in the meantime, the copy stays and gets the missing curves
    from the original.
    """
    copy = animation.action
    if copy is not None and digest.action_digest(copy) != print_before:
        curves.copy_paths(original, curves.channels(animation, create=True), paths)
        return
    animation.action = original
    curves.delete_action(copy)
