"""The current job, of which there is one at most, and the engines that all jobs share."""

import atexit
import time
from pathlib import Path
from weakref import WeakSet

import bpy
from bpy.app.handlers import persistent

from ..core import model_card, native
from ..core.job import Job
from ..core.lazy import LazyEngine
from . import preferences

# `stop` waits at most this long for running jobs, seconds.
PATIENCE_S = 30.0

current: Job | None = None
# The object that the current job animates.
current_name = ""
# Why the current job was cancelled, if not by the artist.
why_cancelled = ""
# The key: system, folder of the models, when these last changed, folder of the emotion model.
_engines: dict[tuple[str, Path | None, int, Path | None], LazyEngine] = {}
# Jobs whose threads may still run. A cancelled job is no longer the current one while its thread
# ends; only the thread keeps it alive then.
_started: WeakSet[Job] = WeakSet()


def engine(system: str, folder: str | Path | None = None) -> LazyEngine:
    """The engine of a system.

    Its models are loaded once, by the worker that uses them first. `folder` holds the models; None
    takes those of the current scene.
    """
    models = Path(folder) if folder else preferences.model_folder(bpy.context.scene)
    key = system, models, model_card.changed_ns(models) if models else 0
    if key not in _engines:
        threads, cache = preferences.threads(), preferences.cache_folder()
        _engines[key] = LazyEngine(lambda: native.Engine(threads, cache, system, models), models)
    return _engines[key]


def start(job: Job, object_name: str) -> Job:
    """Starts `job` and makes it the current one."""
    global current, current_name
    # This raises if the system refuses another thread. Then no job becomes the current one.
    job.start()
    current, current_name = job, object_name
    _started.add(job)
    return job


def is_running() -> bool:
    """True while a job runs or its result waits to be written."""
    return current is not None


def finish() -> None:
    """Forgets the current job."""
    global current, current_name, why_cancelled
    current, current_name, why_cancelled = None, "", ""


def stop() -> None:
    """Ends all jobs and frees the engines, when the add-on is disabled or Python ends."""
    jobs = list(_started)
    for job in jobs:
        job.progress.cancel()
    last = time.monotonic() + PATIENCE_S
    ended = [job.wait(max(0.0, last - time.monotonic())) for job in jobs]
    finish()
    # A job that has not ended may still use the engines, so they stay open.
    for loaded in _engines.values() if all(ended) else ():
        loaded.close()
    _engines.clear()


@persistent
def _on_load(*_) -> None:
    """Cancels the job when another file is opened, since its object is gone."""
    if current is not None:
        current.cancel()
    finish()


@persistent
def _on_undo(*_) -> None:
    """Cancels the job after an undo, since mesh and settings may have changed."""
    global why_cancelled
    if current is not None:
        why_cancelled = "cancelled: something was undone meanwhile"
        current.cancel()


def register() -> None:
    """Watches for files being opened, and for undo."""
    # Python can end without disabling add-ons first.
    atexit.register(stop)
    bpy.app.handlers.load_pre.append(_on_load)
    bpy.app.handlers.undo_post.append(_on_undo)
    bpy.app.handlers.redo_post.append(_on_undo)


def unregister() -> None:
    """Stops all jobs, and no longer watches."""
    atexit.unregister(stop)
    stop()
    bpy.app.handlers.load_pre.remove(_on_load)
    bpy.app.handlers.undo_post.remove(_on_undo)
    bpy.app.handlers.redo_post.remove(_on_undo)
