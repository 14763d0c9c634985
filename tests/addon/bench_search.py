"""What it costs to refuse a mesh without a face, and to cancel that: docs/measured/speed.md.

Part of `bench_blender.py`: balls with bumps, larger and larger.
"""

import importlib
import time

import bpy

from conftest import PACKAGE

SUBDIVISIONS = (6, 8)
# A search is cancelled after these parts of its time.
CANCELLED_AFTER = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95)


def measure(empty):
    """Of each ball: vertices, seconds to refuse it, the longest from cancel to the end."""
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
    """A search in a thread."""
    search = importlib.import_module(f"{PACKAGE}.ui.landmarks").search_of(ob)
    return importlib.import_module(f"{PACKAGE}.core.job").Job(search.work).start()


def cancels(ob, whole_s):
    """Seconds from cancel to the end, at several times."""
    for part in CANCELLED_AFTER:
        job = start(ob)
        time.sleep(part * whole_s)
        job.progress.cancel()
        yield ended(job)


def ended(job):
    """Seconds until it fails, as it must."""
    began = time.perf_counter()
    try:
        job.result()
    except Exception as error:
        assert "no face" in str(error) or "cancelled" in str(error), error
        return time.perf_counter() - began
    raise AssertionError("a face was found on a ball")
