"""Makes the pictures of the pages as an artist would: with the extension in Blender.

    target/venvs/bpy/bin/python packaging/demo/sheets.py --extension target/anyface-….zip \
        --audio demo-output/voice.wav --out docs/images [--clips ../shared/data/speech/emodb_de] [SHEET …]
"""

import argparse
import itertools
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import make_demo

# make_demo sets where Blender keeps its settings before it imports bpy.
from make_demo import bpy

FPS = 25
SUZANNE = Path(__file__).with_name("suzanne_landmarks.json")
CLOSE, CAMERA = (560, -0.3), {"WOMAN": (205, 0.25), "PLAIN": (250, 0.4), "SUZANNE": (250, 0.2)}
"""The camera's lens in millimetres and its height, for the mouth and for a whole head."""
ANYFACE_HEAD = (250, 0.2)
"""The same for a whole head made by *Anyface Head*."""
WIDTH = 220
"""Width of one picture in a sheet, in pixels."""
TRAITS, SLIDERS = {"age": 0, "sex": 1, "weight": 2, "african": 3, "asian": 4}, 22
"""Indices among the sliders of *Add > Mesh > Anyface Head*, and the number of sliders."""
RECORDINGS = ("03a01Wa.ogg", "03a02Fc.ogg", "03a04Ad.ogg", "03a02Ta.ogg")
"""Anger, joy, fear and sadness by one actor of the Berlin Database of Emotional Speech."""


@dataclass(frozen=True)
class Shot:
    """One picture: a head, its performance, and the second that is shown. None shows it at rest.

    `head` is "PLAIN", "WOMAN", "SUZANNE", the seed of a generated head, or a trait and its value on
    the average head. `events` are (name, begin, length) with times in seconds. `emotion_of` names a
    recording among the clips.
    """

    head: str | int | tuple[str, float] = "PLAIN"
    second: float | None = None
    system: str = "freetalk"
    emotion: str = "neutral"
    strength: float = 1.0
    events: tuple[tuple[str, float, float], ...] = ()
    emotion_of: str = ""
    is_close_up: bool = False


def sheets() -> dict[str, list[list[Shot]]]:
    """The rows of shots for each file."""
    woman, cafe = Shot("WOMAN"), Shot(system="cafe-talk")
    smile = replace(cafe, events=(("smile", 1.0, 1.2),))
    wink = replace(cafe, events=(("wink", 1.0, 0.6),))
    sneer = replace(cafe, events=(("sneer", 1.0, 1.2),))
    frown = replace(cafe, emotion="happy", strength=0.7, events=(("frown", 1.0, 1.2),))
    laugh = replace(cafe, events=(("sarcastic laugh", 1.0, 1.2),))
    events = {
        f"cafe-talk/{name}.png": [
            [replace(shot, head=head, second=second) for second in (0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.2, 2.6)]
            for shot in (cafe, smile, wink, frown, laugh)
        ]
        for name, head in (("default", "PLAIN"), ("seed", 3), ("suzanne", "SUZANNE"))
    }
    happy = Shot(10, system="facetalk", emotion="happy", strength=0.7)
    seconds = (None, 0.5, 1.0, 1.5, 2.0, 2.5)
    sliders = [("age", -3.0), ("age", 3.0), ("sex", -3.0), ("sex", 3.0)]
    sliders += [(name, 3.0) for name in ("weight", "african", "asian")]
    return events | {
        "emotions.jpg": [
            [
                replace(woman, emotion=emotion, second=second)
                for emotion in ("neutral", "happy", "sad", "angry", "surprised")
            ]
            for second in (1.2, 2.4)
        ],
        "cafe_talk.png": [
            [cafe, *(replace(shot, second=1.4) for shot in (smile, wink, sneer, frown))]
        ],
        "emoface.png": [
            [
                Shot(head, 1.2, "emoface", emotion_of=clip)
                for clip in ("", *RECORDINGS)
            ]
            for head in ("PLAIN", 3, "SUZANNE")
        ],
        "facetalk/heads.png": [
            [Shot(seed) for seed in range(1, 8)],
            [Shot(seed) for seed in range(8, 15)],
            [Shot(trait) for trait in sliders],
        ],
        "facetalk/talking.png": [
            [replace(happy, second=second, is_close_up=is_close_up) for second in seconds]
            for is_close_up in (False, True)
        ],
        "facetalk/sides.png": [
            [Shot(head, second, system) for head in ("PLAIN", 10, "SUZANNE") for second in (1.2, 2.4)]
            for system in ("freetalk", "facetalk")
        ],
    }  # fmt: skip


def performance(shot: Shot) -> Shot:
    """The part of a shot that decides its animation. Equal performances share one animation."""
    return replace(shot, second=None if shot.second is None else 0.0, is_close_up=False)


class Studio:
    """Blender with a stage on which one head at a time stands and speaks."""

    def __init__(self, extension: Path, audio: Path, clips: Path | None):
        make_demo.install(extension.resolve())
        self.audio, self.clips = audio.resolve(), clips
        self.performance: Shot | None = None

    def draw(self, shot: Shot, path: Path) -> None:
        """Renders one shot. Reuses the previous shot's animation if the performance is the same."""
        if performance(shot) != self.performance:
            self._set(shot)
            if shot.second is not None:
                self._speak(shot)
            self.performance = performance(shot)
        scene = bpy.context.scene
        lens, height = CLOSE if shot.is_close_up else CAMERA.get(shot.head, ANYFACE_HEAD)
        scene.camera.data.lens, scene.camera.location.z = lens, height
        scene.frame_set(1 + round(FPS * (shot.second or 0.0)))
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)

    def _set(self, shot: Shot) -> None:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scene = bpy.context.scene
        make_demo.stage(scene, FPS)
        make_demo.sound(scene, self.audio)
        scene.render.resolution_x, scene.render.resolution_y = WIDTH, WIDTH * 6 // 5
        scene.cycles.samples = 16
        self.head = head(shot.head)

    def _speak(self, shot: Shot) -> None:
        scene, face = bpy.context.scene, self.head.anyface
        face.system = shot.system
        for name, begin, length in shot.events:
            scene.timeline_markers.new(name, frame=1 + round(FPS * begin))
            self.head.anyface_audio.event_markers = True
            self.head.anyface_audio.marker_s = length
        if shot.emotion_of:
            if self.clips is None:
                raise SystemExit(f"expected --clips DIR with {shot.emotion_of}, got none")
            path = (self.clips / shot.emotion_of).resolve()
            make_demo.add_strip(scene, "Emotion", path, channel=2)
            self.head.anyface_audio.emotion_strip = "Emotion"
            face.emotion_source = "VOICE"
        options = argparse.Namespace(emotion=shot.emotion, intensity=shot.strength)
        make_demo.animate(self.head, options)


def head(which: str | int | tuple[str, float]):
    """Adds the head of a shot, with its face in the middle of the stage."""
    if which == "SUZANNE":
        ob = make_demo.suzanne(SUZANNE)
        ob.location, ob.scale = (0.0, 0.0, 0.2), (1.3,) * 3
        return ob
    if isinstance(which, str):
        return make_demo.character(which, (0.0, 0.0, 0.0))
    seed, changes = 0, [0.0] * SLIDERS
    if isinstance(which, int):
        seed = which
    else:
        trait, value = which
        changes[TRAITS[trait]] = value
    bpy.ops.anyface.add_head(seed=seed, changes=changes, height=2.6, location=(0.0, 0.0, 0.0))
    return bpy.context.object


def tile(folder: Path, columns: int, rows: int, out: Path) -> None:
    """Joins all pictures of a folder into one."""
    out.parent.mkdir(parents=True, exist_ok=True)
    command = ["ffmpeg", "-y", "-loglevel", "error", "-i", str(folder / "%03d.png")]
    tiled = f"tile={columns}x{rows}:padding=2"
    if out.suffix == ".png":
        # The colours of skin in front of a wall fit into one palette.
        tiled += ",split[a][b];[a]palettegen[p];[b][p]paletteuse=dither=none"
    subprocess.run([*command, "-vf", tiled, "-frames:v", "1", "-q:v", "3", str(out)], check=True)


def main() -> None:
    """Draws the sheets."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("--extension", "--audio", "--out"):
        parser.add_argument(name, required=True, type=Path)
    parser.add_argument("--clips", type=Path, help="recordings that EmoFace feels")
    parser.add_argument("sheets", nargs="*", metavar="SHEET", help="such as emoface.png; none: all")
    options = parser.parse_args()
    studio = Studio(options.extension, options.audio, options.clips)
    every = sheets()
    for name in options.sheets or every:
        rows = every[name]
        with tempfile.TemporaryDirectory() as folder:
            shots = enumerate(itertools.chain.from_iterable(rows))
            for place, shot in sorted(shots, key=lambda placed: str(performance(placed[1]))):
                studio.draw(shot, Path(folder) / f"{place:03d}.png")
            tile(Path(folder), len(rows[0]), len(rows), options.out / name)


if __name__ == "__main__":
    main()
