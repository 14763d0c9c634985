"""Blender as a Python module exits during a job: the thread is joined and nothing hangs."""

import os
import subprocess
import sys

import pytest

from conftest import PACKAGE
from figures import tone

# A script that ends before its job does. `sys.argv[1]` is a sound file.
_SCRIPT = """
import sys, time
import bpy, addon_utils
addon_utils.enable({package!r})
import importlib
running = importlib.import_module({package!r} + '.ui.running')
Job = importlib.import_module({package!r} + '.core.job').Job
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
{work}
job = running.start(Job(work), 'Head')
while job.progress.at[0] == '' and not job.done:
    time.sleep(0.005)
assert not job.done
print('ends', flush=True)
"""
_WAITS = """
def work(progress):
    try:
        while True:
            progress.check('sound')
            time.sleep(0.005)
    finally:
        print('joined', flush=True)
"""
_SPEAKS = """
bpy.ops.anyface.add_sample_head()
ob = bpy.context.object
ob.anyface.source, ob.anyface.sound_file = 'FILE', sys.argv[1]
bake = importlib.import_module({package!r} + '.scene.bake')
settings = importlib.import_module({package!r} + '.ui.settings').from_object(ob)
snapshot = bake.read(ob, bpy.context.scene, settings, running.engine(settings.system))
def work(progress):
    try:
        return snapshot.work(progress)
    finally:
        print('joined', flush=True)
""".replace("{package!r}", repr(PACKAGE))


# Imitates a Blender that exits without disabling its add-ons.
_STAYS_ON = "addon_utils.disable_all = lambda: None\n"
# A job that sleeps and so never notices that it should end.
_DEAF = """
running.PATIENCE_S = 0.5
def work(progress):
    progress.check('sound')
    time.sleep(600)
"""


def ended(tmp_path, work):
    """Runs a script that ends before its job, and returns the finished process."""
    sound = tone(tmp_path / "long.wav", 120.0)
    script = _SCRIPT.format(package=PACKAGE, work=work)
    command = [sys.executable, "-c", script, sound]
    return subprocess.run(command, env=os.environ, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("work", [_WAITS, _SPEAKS, _STAYS_ON + _WAITS, _STAYS_ON + _SPEAKS])
def test_a_running_job_is_joined_when_python_ends(installed, tmp_path, work):
    done = ended(tmp_path, work)
    assert done.stdout.rstrip().endswith("joined"), (done.stdout, done.stderr)
    assert done.returncode == 0, done.stderr


def test_a_job_that_does_not_end_keeps_nobody(installed, tmp_path):
    done = ended(tmp_path, _DEAF)
    assert done.stdout.rstrip().endswith("ends") and done.returncode == 0, done.stderr
