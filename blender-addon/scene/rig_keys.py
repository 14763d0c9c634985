"""The 52 ARKit shapes, and the visemes if wanted, as shape keys of a mesh."""

from ..core import shapes
from ..core.errors import AnyfaceError
from . import guard


def check(ob, visemes: bool) -> None:
    """Raises `AnyfaceError("mesh")` where the artist has keys of these names."""
    if ob.data.shape_keys is None:
        return
    wanted = {*shapes.ARKIT, *(shapes.VISEMES if visemes else ())}
    taken = [name for name in guard.own_keys(ob.data.shape_keys) if name in wanted]
    if taken:
        raise AnyfaceError(
            "mesh",
            f"{ob.name} has a key {taken[0]} of its own: choose Existing Keys, which animates it",
        )
