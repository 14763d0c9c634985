"""A copy of the artist's action, without some of its curves, plays in its place for a while."""

from . import curves, digest


def play(holder, name: str, animation, paths: set[str]) -> str:
    """Lets a copy of the action without `paths` play, and saves the original in `holder[name]`.

    Returns the digest of the copy; "" where the action has none of these curves.
    """
    original = animation.action if animation is not None else None
    if original is None or not any(curves.find_any(animation, path) for path in paths):
        return ""
    holder[name] = original
    animation.action = original.copy()
    curves.remove(animation, paths)
    return digest.action_digest(animation.action)


def give_back(original, animation, paths: set[str], print_before: str) -> None:
    """Lets the original play again.

    Where the artist has worked in the copy since, the copy stays and gets the curves that were
    taken out.
    """
    copy = animation.action
    if copy is not None and digest.action_digest(copy) != print_before:
        curves.copy_paths(original, curves.channels(animation, create=True), paths)
        return
    animation.action = original
    curves.delete_action(copy)
