"""`anyface landmarks`: finds the 68 landmarks of a face and stores them on its object."""

import argparse
import json
import os

import bpy

from ..core import json_file
from ..core.job import Progress
from ..scene.face import landmarks, mesh
from ..ui.landmarks import keep, search_of
from .bake import named


def run(options: argparse.Namespace) -> dict:
    """Finds and stores the landmarks; with `out`, also writes them as JSON."""
    ob = named(bpy.data.objects, options.object, "object")
    search = search_of(ob, options.weights)
    search.face.axes = options.axes or search.face.axes
    text = keep(ob, search.work(Progress()))
    done = {"message": text, "confidence": round(landmarks.load(ob).sure, 4)}
    if options.out:
        done["landmarks"] = os.path.abspath(options.out)
        json_file.write(done["landmarks"], json.loads(ob[mesh.LANDMARKS_PROPERTY]))
    return done
