"""One session of Blender with user files of its own; `test_blender.py` starts it.

The arguments after `--` are the action, the address of the repository, a head, and a sound. The
session prints a line of JSON.
"""

import json
import os
import sys
import tomllib
from pathlib import Path

import bpy

PACKAGE = "bl_ext.anyface_site.anyface"
action, address, head, sound = sys.argv[sys.argv.index("--") + 1 :]
if not bpy.app.binary_path:
    # Blender as a Python module starts with factory preferences, so read the user's.
    bpy.ops.wm.read_userpref()
preferences = bpy.context.preferences
# The executable gets `--online-mode` instead, and then nobody can change this preference.
if not bpy.app.online_access:
    preferences.system.use_online_access = True


def subscribe():
    """Adds the repository as an artist does, and removes the others that Blender would contact."""
    repositories = preferences.extensions.repos
    for other in [repository for repository in repositories if repository.use_remote_url]:
        repositories.remove(other)
    repositories.new(name="Anyface Site", module="anyface_site", remote_url=address)
    sync()


def index():
    """The number of the repository in Blender's list."""
    modules = [repository.module for repository in preferences.extensions.repos]
    return modules.index("anyface_site")


def sync():
    """Reads the repository's list."""
    bpy.ops.extensions.repo_sync(repo_index=index())


def install():
    """Installs and enables the extension, and changes a setting."""
    bpy.ops.extensions.package_install(repo_index=index(), pkg_id="anyface", enable_on_install=True)
    preferences.addons[PACKAGE].preferences.threads = 3


def speak():
    """Animates the head; returns the largest motion of a vertex in millimetres."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.obj_import(filepath=head, use_split_objects=False, use_split_groups=False)
    ob = bpy.context.object
    bpy.context.view_layer.objects.active = ob
    settings = ob.anyface
    settings.source, settings.sound_file, settings.start_frame = "FILE", sound, 1
    assert bpy.ops.anyface.generate() == {"FINISHED"}
    largest = 0.0
    for frame in range(1, 25):
        bpy.context.scene.frame_set(frame)
        shape = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        pairs = zip(shape.vertices, ob.data.vertices, strict=True)
        largest = max(largest, max((moved.co - rest.co).length for moved, rest in pairs))
    return 1000 * largest


result = {"online": bpy.app.online_access}
if action == "install":
    subscribe()
    install()
elif action == "update":
    sync()
    bpy.ops.extensions.package_upgrade_all()
if action in ("install", "speak"):
    result["moved_mm"] = speak()
folder = Path(preferences.extensions.repos[index()].directory) / "anyface"
manifest = tomllib.loads((folder / "blender_manifest.toml").read_text())
result |= {key: manifest[key] for key in ("version", "platforms")}
result["enabled"] = PACKAGE in preferences.addons
result["threads"] = preferences.addons[PACKAGE].preferences.threads
bpy.ops.wm.save_userpref()
print("RESULT", json.dumps(result), flush=True)
# bpy 4.2 crashes and bpy 4.5 may hang while Python ends after an add-on.
os._exit(0)
