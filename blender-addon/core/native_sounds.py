"""Library calls about sounds of speech, and about a stretch of motion."""

import os
import tempfile
from contextlib import ExitStack
from ctypes import POINTER, c_double
from dataclasses import replace

import numpy as np

from .arrays import bytes_of, path_of
from .calls import Calls
from .errors import AnyfaceError
from .job import Progress
from .native_shapes import Clip
from .take import Animation, Request, Sound

_PHONES, _WORDS, _MOUTHS, _CLOSURES = range(4)
"""The values of `AnyfaceTier` in the C interface."""
# In the order of `AnyfaceMouths`.
MOUTHS = ("rhubarb", "preston-blair")


class SoundCalls(Calls):
    """The calls of `native.Engine` for sounds of speech."""

    def listen(self, sound: Sound) -> np.ndarray:
        """Hears when the lips are closed for p, b and m: `[N, 2]`, start and end in seconds.

        Raises `AnyfaceError`.
        """
        with ExitStack() as handles:
            audio = self._audio(handles, sound)
            sounds = self._own(handles, "sounds", "anyface_sounds_new", self._handle, audio)
            return self._closures(sounds)

    def listen_to_words(
        self, sound: Sound, text: str
    ) -> tuple[np.ndarray, list[tuple[float, float, str]]]:
        """As `listen`, and start and end in seconds and label of each word of `text`."""
        with ExitStack() as handles:
            arguments = self._handle, self._audio(handles, sound), bytes_of("text", text)
            sounds = self._own(handles, "sounds", "anyface_sounds_new_with_text", *arguments)
            return self._closures(sounds), self._intervals(sounds, _WORDS)

    def chart(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        sound: Sound,
        request: Request,
        progress: Progress,
        mouths: str = "rhubarb",
        on: int = 1,
        hold: int = 2,
        path: str = "",
        closure_hold: int = 0,
        vowel_hold: int = 0,
    ) -> list[tuple[float, float, str]]:
        """The drawn mouths of a take in order: start and end in seconds, and name of each.

        `mouths` is one of `MOUTHS`. A mouth may change only at every `on`-th frame and stays for
        `hold` frames or longer. `closure_hold` is the same for lips that close for p, b and m,
        `vowel_hold` for the mouths of vowels; 0 stands for `hold`. If the request has closures, the
        lips close in those. With `path` the chart is also written there, as by `write_sounds`. The
        other arguments are those of `native.Engine.animate`. Raises `AnyfaceError`, or `Cancelled`.
        """
        if mouths not in MOUTHS:
            known = " or ".join(MOUTHS)
            raise AnyfaceError("input", f"mouths: expected {known}, got {mouths!r}")
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            marks = landmarks, landmark_vertices
            face = self._face(handles, positions, triangles, marks, request, watch)
            _, clip = self._spoken(handles, face, sound, replace(request, keeps_clip=False), watch)
            text = bytes_of("text", request.fields.get("text", "")) or None
            heard = self._handle, self._audio(handles, sound), text
            said = self._own(handles, "sounds", "anyface_sounds_new_with_text", *heard)
            closures = request.fields.get("closures")
            if closures is not None:
                said = self._mended(handles, said, closures, request.fps)
            arguments = clip, said, MOUTHS.index(mouths), on, hold, closure_hold, vowel_hold
            drawn = self._own(handles, "sounds", "anyface_sounds_new_chart", *arguments)
            if path:
                self._call("anyface_sounds_write", drawn, path_of(path), request.fps)
            return self._intervals(drawn, _MOUTHS)

    def _mended(self, handles, said, closures: np.ndarray, fps: float):
        """The phones of `said`, with `closures` `[N, 2]` in place of those that close lips; None
        if no interval is left."""
        rows = [(*ends, "m") for ends in closures.tolist()]
        for start_s, end_s, phone in self._intervals(said, _PHONES):
            if self.closes_lips(phone):
                continue
            # Phones make room for closures: the intervals of a tier must not overlap.
            after = [b for a, b, _ in rows if a <= start_s < b]
            until = [a for a, _, _ in rows if start_s < a < end_s]
            start_s, end_s = max([start_s, *after]), min([end_s, *until])
            if end_s > start_s:
                rows.append((start_s, end_s, phone))
        if not rows:
            return None
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "sounds.txt")
            with open(path, "w", encoding="utf-8") as file:
                file.writelines(f"{a:.6f} {b:.6f} {label}\n" for a, b, label in sorted(rows))
            return self._own(handles, "sounds", "anyface_sounds_read", path_of(path), fps)

    def _intervals(self, sounds, tier: int) -> list[tuple[float, float, str]]:
        times = self._times(sounds, tier)
        label = self._library.anyface_sounds_label
        labels = [label(sounds, tier, at).decode() for at in range(len(times))]
        return [(*ends, text) for ends, text in zip(times.tolist(), labels, strict=True)]

    def read_sounds(self, path: str, fps: float) -> np.ndarray:
        """Closures as of `listen`, from a file of another tool; .dat counts frames at `fps`."""
        with ExitStack() as handles:
            arguments = path_of(path), fps
            return self._closures(self._own(handles, "sounds", "anyface_sounds_read", *arguments))

    def write_sounds(
        self, path: str, labelled: list[tuple[float, float, str]], duration_s: float, fps: float
    ) -> None:
        """Writes start and end in seconds and label of each interval to a file for another tool.

        The ending of `path` selects the kind of file; .pgo and .dat count frames at `fps`.
        """
        rows = [f"{start_s:.6f} {end_s:.6f} {label}" for start_s, end_s, label in labelled]
        if labelled and not path.lower().endswith(".txt"):
            # A label of zero length marks the end of the sound.
            rows.append(f"{duration_s:.6f} {duration_s:.6f} {labelled[-1][2]}")
        with tempfile.TemporaryDirectory() as folder, ExitStack() as handles:
            lines = os.path.join(folder, "sounds.txt")
            with open(lines, "w", encoding="utf-8") as file:
                file.write("\n".join(rows))
            arguments = path_of(lines), fps
            sounds = self._own(handles, "sounds", "anyface_sounds_read", *arguments)
            self._call("anyface_sounds_write", sounds, path_of(path), fps)

    def closes_lips(self, label: str) -> bool:
        """True for phones such as p, b and m."""
        return self._library.anyface_sounds_label_closes_lips(bytes_of("label", label)) == 1

    def _closures(self, sounds) -> np.ndarray:
        return self._times(sounds, _CLOSURES)

    def _times(self, sounds, tier: int) -> np.ndarray:
        """Start and end in seconds of each interval of a tier `[N, 2]`."""
        times = np.empty((self._library.anyface_sounds_interval_count(sounds, tier), 2))
        doubles = times.ctypes.data_as(POINTER(c_double))
        self._call("anyface_sounds_copy_intervals", sounds, tier, doubles, times.size)
        return times

    def animate_stretch(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        sound: Sound,
        request: Request,
        progress: Progress,
        rows: range,
    ) -> Animation:
        """Displacements, head, gaze and tongue of the frames `rows` of `native.Engine.animate`."""
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            marks = landmarks, landmark_vertices
            face = self._face(handles, positions, triangles, marks, request, watch)
            spoken = self._motion(handles, sound, request, watch)
            weights = self._shape_weights(spoken)
            if weights is not None:
                return self._stretch_of_weights(handles, (face, spoken), weights, rows)
            frames = self._library.anyface_motion_frame_count(spoken)
            part = range(max(rows.start, 0), min(rows.stop, frames))
            stretch = (spoken, part.start, len(part))
            motion = self._own(handles, "motion", "anyface_motion_new_frames", *stretch)
            arguments = (self._handle, face, motion, watch.handle)
            clip = Clip(self, self._make("anyface_clip_new", *arguments))
            handles.callback(clip.close)
            animation = Animation(self._millimetres(face, clip))
            animation.unit_mm = self._unit_mm(face)
            animation.displacements = clip.displacements()
            animation.life = self._life((face, motion, clip), len(part))
        return animation

    def _stretch_of_weights(self, handles, arguments, weights, rows: range) -> Animation:
        """The same for motion that is weights: moves the mesh in all frames, then takes `rows`."""
        face, spoken = arguments
        clip = Clip(self, self._make("anyface_clip_new", self._handle, face, spoken, None))
        handles.callback(clip.close)
        part = slice(max(rows.start, 0), min(rows.stop, len(weights.weights)))
        animation = Animation(self._millimetres(face, clip))
        animation.unit_mm = self._unit_mm(face)
        animation.displacements = clip.displacements()[part]
        life = self._life((face, spoken, clip), len(weights.weights))
        animation.life = replace(
            life, head=life.head[part], gaze=life.gaze[part], tongue=life.tongue[part]
        )
        animation.shape_weights = replace(weights, weights=weights.weights[part])
        return animation

    def _millimetres(self, face, clip) -> float:
        """The largest displacement of a clip on a head of human size."""
        largest = self._library.anyface_clip_largest_displacement(clip)
        return self._unit_mm(face) * largest

    def _unit_mm(self, face) -> float:
        """The length of a unit of the mesh on a head of human size."""
        return 1000.0 * self._library.anyface_face_metres_per_unit(face)
