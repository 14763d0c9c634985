"""A talking head and a talking Suzanne: scene and animation by the extension, as a .blend.

Run by `cargo xtask demo` in Blender's Python module, and `render.py` after it.
"""

import argparse
import math
import os
import tempfile
import time
from pathlib import Path

# Blender reads this once, at import: nothing of the user's own Blender is touched.
os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix="anyface-demo-")

import bpy  # noqa: E402

SIZE = (560, 350)
SAMPLES = 6
HEAD_SEED, HEAD_HEIGHT = 10, 3.8
HEAD_PLACE = (1.32, 0.0, -0.42)
FUR = (0.30, 0.16, 0.09, 1.0)


def main() -> None:
    """Makes the file `--out`."""
    options = arguments()
    install(options.extension)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    stage(scene, options.fps)
    sound(scene, options.audio)
    heads = [suzanne(options.suzanne_landmarks), made_head()]
    for ob in heads:
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
    parser.add_argument("--emotion", default="neutral")
    parser.add_argument("--intensity", type=float, default=0.0)
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
    """Camera, three lights, a plain background; Cycles on the CPU."""
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.max_bounces = 4
    # The quick denoiser takes a third of the time of the thorough one and looks the same here.
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
    light("Key", (-3.0, -5.0, 3.0), 380.0, 2.0)
    light("Fill", (4.0, -4.0, 0.5), 130.0, 3.0)
    light("Rim", (0.5, 3.0, 3.0), 320.0, 1.5)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = 72
    camera.location = (0.0, -11.2, 0.05)
    camera.rotation_euler = (math.radians(90), 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera


def light(name: str, place: tuple, watts: float, size: float) -> None:
    """An area light that looks at the middle of the stage."""
    data = bpy.data.lights.new(name, "AREA")
    data.energy, data.size = watts, size
    ob = bpy.data.objects.new(name, data)
    ob.location = place
    direction = -ob.location
    ob.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(ob)


def sound(scene, path: Path) -> None:
    """The recording as a strip, and the scene as long as it."""
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strip = strips.new_sound("Voice", str(path), channel=1, frame_start=1)
    scene.frame_start, scene.frame_end = 1, max(2, int(strip.frame_final_end))
    scene.sync_mode = "AUDIO_SYNC"


def suzanne(landmarks: Path):
    """Blender's monkey with landmarks marked by hand, smooth."""
    bpy.ops.mesh.primitive_monkey_add(location=(-1.45, 0, 0.25))
    ob = bpy.context.object
    ob.data.materials.append(material("Fur", FUR, 0.6))
    for polygon in ob.data.polygons:
        polygon.use_smooth = True
    ob.modifiers.new("Smooth", "SUBSURF").levels = 1
    ob["anyface_landmarks"] = landmarks.read_text()
    return ob


def made_head():
    """A head made from numbers, as *Add > Mesh > Anyface Head* adds it, beside Suzanne."""
    bpy.ops.anyface.add_head(seed=HEAD_SEED, height=HEAD_HEIGHT, location=HEAD_PLACE)
    ob = bpy.context.object
    polish(ob)
    ob.modifiers.new("Smooth", "SUBSURF").levels = 1
    return ob


def polish(ob) -> None:
    """Eyes and teeth shine, skin is soft; the colours are those of the file."""
    for slot in ob.material_slots:
        name = slot.material.name.lower()
        wet = any(word in name for word in ("eye", "iris", "pupil", "cornea", "teeth", "tongue"))
        finish(slot.material, 0.12 if wet else 0.5)


def material(name: str, colour: tuple, roughness: float):
    """A principled material."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    finish(made, roughness).inputs["Base Color"].default_value = colour
    return made


def finish(made, roughness: float):
    """Sets the roughness of a material and returns its shader."""
    shader = next(node for node in made.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Roughness"].default_value = roughness
    return shader


def animate(ob, options) -> None:
    """Presses Generate."""
    began = time.monotonic()
    bpy.context.view_layer.objects.active = ob
    ob.anyface.source, ob.anyface.strip = "STRIP", "Voice"
    ob.anyface.emotion, ob.anyface.intensity = options.emotion, options.intensity
    bpy.context.scene.anyface.character = ob
    if bpy.ops.anyface.generate() != {"FINISHED"}:
        raise SystemExit(f"{ob.name}: {ob.anyface.report}")
    print(f"demo: {ob.name}: {ob.anyface.report} ({time.monotonic() - began:.1f} s)", flush=True)


if __name__ == "__main__":
    main()
