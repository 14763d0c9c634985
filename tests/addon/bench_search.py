"""Times the search on meshes without a face, until it refuses them and until a cancel ends it.

Part of `bench_blender.py`, for docs/measured/speed.md. The meshes are balls with bumps, each with
more vertices than the one before.
"""

import importlib
import time

import bpy

from conftest import PACKAGE

SUBDIVISIONS = (6, 8)
# Searches are cancelled after these shares of the time of a whole search.
CANCELLED_AFTER = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95)


def measure(empty):
    """Yields per ball: vertices, seconds to refuse it, longest time from cancel to the end."""
    for subdivisions in SUBDIVISIONS:
        empty()
        ob = ball(subdivisions)
        refused_s = ended(start(ob))
        yield len(ob.data.vertices), refused_s, max(cancels(ob, refused_s))


def ball(subdivisions):
    """A ball with bumps."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=subdivisions)
    ob = bpy.context.object
    modifier = ob.modifiers.new("Bumps", "DISPLACE")
    modifier.texture, modifier.strength = bpy.data.textures.new("Bumps", "CLOUDS"), 0.3
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    return ob


def start(ob):
    """Starts a search in a thread."""
    search = importlib.import_module(f"{PACKAGE}.ui.landmarks").search_of(ob)
    return importlib.import_module(f"{PACKAGE}.core.job").Job(search.work).start()


def cancels(ob, whole_s):
    """Yields the seconds from cancel to the end, for cancels at several times."""
    for part in CANCELLED_AFTER:
        job = start(ob)
        time.sleep(part * whole_s)
        job.progress.cancel()
        yield ended(job)


def ended(job):
    """Waits until the job fails, as it must, and returns the seconds."""
    began = time.perf_counter()
    try:
        job.result()
    except Exception as error:
        assert "no face" in str(error) or "cancelled" in str(error), error
        return time.perf_counter() - began
    raise AssertionError("a face was found on a ball")
