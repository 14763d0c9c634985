"""Makes a .blend with three talking heads and a talking Suzanne, animated by the extension.

`cargo xtask demo` runs this in Blender's Python module, then `render.py`.
"""

import argparse
import math
import os
import tempfile
import time
from pathlib import Path

# Blender reads this once, at import. The user's own Blender stays untouched.
os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix="anyface-demo-")

import bpy  # noqa: E402
from mathutils import Vector  # noqa: E402

SIZE = (1280, 720)
SAMPLES = 1
"""With the denoiser one ray per pixel is enough. A frame then takes 3.6 s of processor time."""
CHARACTERS = {"WOMAN": (-2.75, 0.0, 0.0), "MAN": (-0.85, 1.3, 0.1), "CARTOON": (1.05, 0.0, 0.0)}
HEIGHT = 3.2
SUZANNE_PLACE = (2.85, 0.9, 0.55)
FUR = (0.30, 0.16, 0.09, 1.0)
HAPPY = ((0.0, 0.7), (0.3, 0.0), (0.8, 0.0), (1.0, 0.6))
SURPRISED = ((0.35, 0.0), (0.6, 0.8), (0.85, 0.0))
"""Keys of each emotion as (time, weight). The sentence lasts from time 0 to 1."""
EVENT, EVENT_AT = "wink", 0.88


def main() -> None:
    """Makes the file `--out`."""
    options = arguments()
    install(options.extension)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    stage(scene, options.fps)
    sound(scene, options.audio)
    if not options.emotion:
        length = scene.frame_end - scene.frame_start
        scene.timeline_markers.new(EVENT, frame=scene.frame_start + round(EVENT_AT * length))
    heads = [character(key, place) for key, place in CHARACTERS.items()]
    for ob in [*heads, suzanne(options.suzanne_landmarks)]:
        if not options.emotion:
            change_moods(ob, scene)
        animate(ob, options)
    if options.frames:
        scene.frame_end = min(scene.frame_end, scene.frame_start + options.frames - 1)
    bpy.ops.wm.save_as_mainfile(filepath=str(options.out))


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--extension", required=True, type=Path, help="the extension's zip")
    parser.add_argument("--audio", required=True, type=Path)
    parser.add_argument("--suzanne-landmarks", required=True, type=Path)
    parser.add_argument("--emotion", default="", help="of the whole sentence; none: several")
    parser.add_argument("--intensity", type=float, default=1.0)
    parser.add_argument("--fps", type=int, default=25)
    parser.add_argument("--frames", type=int, default=0, help="keep at most this many")
    parser.add_argument("--out", required=True, type=Path)
    return parser.parse_args()


def install(zip_path: Path) -> None:
    """Installs the extension as an artist would."""
    bpy.ops.extensions.package_install_files(
        filepath=str(zip_path), repo="user_default", enable_on_install=True
    )
    if "bl_ext.user_default.anyface" not in bpy.context.preferences.addons:
        raise SystemExit(f"{zip_path}: Blender did not install it")


def stage(scene, fps: int) -> None:
    """Sets up a camera, three lights, a plain background, and Cycles on the CPU."""
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.max_bounces = 2
    # With only five lights it is faster to pick them evenly than by the light tree.
    scene.cycles.use_light_tree = False
    # The fast denoiser takes a third of the accurate one's time and looks the same here.
    scene.cycles.use_denoising = True
    scene.cycles.denoising_prefilter = scene.cycles.denoising_quality = "FAST"
    scene.render.use_persistent_data = True
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.fps = fps
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs[0].default_value = (0.05, 0.065, 0.09, 1.0)
    scene.world = world
    light("Key", (-4.0, -6.0, 4.0), 700.0, 2.5, (1.0, 0.93, 0.84))
    light("Fill", (6.0, -5.0, 0.5), 220.0, 4.0, (0.75, 0.86, 1.0))
    light("Rim", (1.0, 4.0, 4.0), 650.0, 3.0, (1.0, 0.97, 0.9))
    backdrop(scene)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = 94
    camera.location = (0.0, -19.0, 0.68)
    camera.rotation_euler = (math.radians(90), 0, 0)
    camera.data.dof.use_dof = True
    camera.data.dof.focus_distance, camera.data.dof.aperture_fstop = 18.2, 0.35
    scene.collection.objects.link(camera)
    scene.camera = camera


def backdrop(scene) -> None:
    """Adds a wall far behind the heads, dark at its rim."""
    bpy.ops.mesh.primitive_plane_add(size=60, location=(0, 14, 0), rotation=(math.radians(90), 0, 0))
    wall = bpy.context.object
    wall.data.materials.append(material("Wall", (0.055, 0.09, 0.14, 1.0), 0.9))
    light("Wall", (0.0, 8.0, 1.0), 500.0, 3.0, (0.6, 0.8, 1.0), (0, 14, 0))


def light(
    name: str, place: tuple, watts: float, size: float, colour: tuple, towards: tuple = (0, 0, 0)
) -> None:
    """Adds an area light that points at `towards`, by default the middle of the stage."""
    data = bpy.data.lights.new(name, "AREA")
    data.energy, data.size, data.color = watts, size, colour
    ob = bpy.data.objects.new(name, data)
    ob.location = place
    direction = Vector(towards) - ob.location
    ob.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(ob)


def sound(scene, path: Path) -> None:
    """Adds the recording as a strip and makes the scene as long as the strip."""
    strip = add_strip(scene, "Voice", path, channel=1)
    scene.frame_start, scene.frame_end = 1, max(2, int(strip.frame_final_end))
    scene.sync_mode = "AUDIO_SYNC"


def add_strip(scene, name: str, path: Path, channel: int):
    """Adds a sound strip that starts at frame 1."""
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    return strips.new_sound(name, str(path), channel=channel, frame_start=1)


def suzanne(landmarks: Path):
    """Adds Blender's monkey, smoothed, with landmarks marked by hand."""
    bpy.ops.mesh.primitive_monkey_add(size=1.8, location=SUZANNE_PLACE)
    ob = bpy.context.object
    ob.data.materials.append(material("Fur", FUR, 0.6))
    for polygon in ob.data.polygons:
        polygon.use_smooth = True
    ob.modifiers.new("Smooth", "SUBSURF").levels = 1
    ob["anyface_landmarks"] = landmarks.read_text()
    return ob


def character(key: str, place: tuple):
    """Adds one of *Add > Mesh > Anyface Sample Heads*."""
    bpy.ops.anyface.add_sample_head(character=key, height=HEIGHT, location=place)
    return bpy.context.object


def change_moods(ob, scene) -> None:
    """Keys two emotions along the sentence, as an artist would, and turns on event markers."""
    face, start, length = ob.anyface, scene.frame_start, scene.frame_end - scene.frame_start
    face.emotion = "happy"
    for at, weight in HAPPY:
        face.intensity = weight
        ob.keyframe_insert("anyface.intensity", frame=start + round(at * length))
    row = face.mixture.add()
    row.emotion = "surprised"
    for at, weight in SURPRISED:
        row.weight = weight
        ob.keyframe_insert("anyface.mixture[0].weight", frame=start + round(at * length))
    ob.anyface_audio.event_markers = True


def material(name: str, colour: tuple, roughness: float):
    """A principled material."""
    new = bpy.data.materials.new(name)
    new.use_nodes = True
    set_roughness(new, roughness).inputs["Base Color"].default_value = colour
    return new


def set_roughness(principled, roughness: float):
    """Sets the roughness of a material and returns its shader."""
    shader = next(node for node in principled.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Roughness"].default_value = roughness
    return shader


def animate(ob, options) -> None:
    """Presses Generate."""
    began = time.monotonic()
    bpy.context.view_layer.objects.active = ob
    ob.anyface.source, ob.anyface.strip = "STRIP", "Voice"
    if options.emotion:
        ob.anyface.emotion, ob.anyface.intensity = options.emotion, options.intensity
    bpy.context.scene.anyface.character = ob
    if bpy.ops.anyface.generate() != {"FINISHED"}:
        raise SystemExit(f"{ob.name}: {ob.anyface.report}")
    print(f"demo: {ob.name}: {ob.anyface.report} ({time.monotonic() - began:.1f} s)", flush=True)


if __name__ == "__main__":
    main()
