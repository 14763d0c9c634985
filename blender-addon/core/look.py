"""Shows a take at a glance: the gap of its lips over the sound, and three pictures.

The result goes into the report of a shot, for the page of a batch.
"""

import base64
from typing import Any

import numpy as np

from . import picture
from .take import FaceMesh, Frames, Sound, Take

# The number of peaks that show a sound, and the width of a picture in pixels.
_PEAKS, _SIZE = 200, 112
# A picture frames the vertices that move by more than the share _MOVES of the largest motion; they
# fill the share _FILLS of its width.
_MOVES, _FILLS = 0.2, 0.5
# Sound below this share of its peak is a pause; lips farther apart than this beyond rest (mm) are
# open.
_QUIET, _OPEN_MM = 0.02, 3.0
# Lips that part or meet faster than this have jumped, mm per second.
_JUMP_MM_S = 400.0
# Lips that are open for more than the share _SHARE of the pauses are worth a look. So are lips that
# never open in speech. Pauses and speech must last longer than _LEAST_S seconds in all.
_SHARE, _LEAST_S = 0.5, 0.5


def of_take(face: FaceMesh, sound: Sound, take: Take) -> dict:
    """Fields of a report: `duration_s` and `wave` (peaks 0 to 1), and others if the take has them.

    These are `gap` (`fps` and `values`, mm beyond rest), `pictures` (`data:` addresses) and
    `warnings`.
    """
    peaks = wave(sound)
    fields = {"duration_s": round(sound.duration_s, 3), "wave": np.round(peaks, 3).tolist()}
    if take.opening is not None:
        gap = np.asarray(take.opening, dtype=np.float64)
        fields["gap"] = {"fps": take.fps, "values": np.round(gap, 2).tolist()}
        fields["warnings"] = doubts(gap, take.fps, sound)
    drawn = pictures(face, take)
    return fields | ({"pictures": drawn} if drawn else {})


def wave(sound: Sound) -> np.ndarray:
    """The peaks `[200]` of a sound, the largest 1."""
    parts = np.array_split(np.abs(sound.samples), _PEAKS)
    peaks = np.array([part.max(initial=0.0) for part in parts])
    return peaks / max(float(peaks.max()), 1e-9)


def doubts(gap: np.ndarray, fps: float, sound: Sound) -> list[str]:
    """Describes what is worth a look in the `gap` `[T]` of the lips, mm beyond rest."""
    hop = max(1, round(sound.rate_hz / fps))
    loud = np.abs(sound.samples[: len(sound.samples) // hop * hop]).reshape(-1, hop).max(axis=1)
    frames = min(len(gap), len(loud))
    if frames < 2:
        return []
    gap, speaks = gap[:frames], loud[:frames] > _QUIET * max(float(loud.max()), 1e-9)
    doubts_found = []
    is_open = gap > _OPEN_MM
    if speaks.sum() > _LEAST_S * fps and not is_open[speaks].any():
        doubts_found.append(
            f"the lips part by no more than {gap.max():.1f} mm while the voice sounds"
        )
    pause = ~speaks
    if pause.sum() > _LEAST_S * fps and is_open[pause].mean() > _SHARE:
        doubts_found.append(f"the lips are open by {np.median(gap[pause]):.1f} mm in pauses")
    speed = np.abs(np.diff(gap)) * fps
    if speed.max() > _JUMP_MM_S:
        at = (int(speed.argmax()) + 1) / fps
        doubts_found.append(f"the lips jump at {at:.2f} s ({speed.max() / fps:.1f} mm in a frame)")
    return doubts_found


def pictures(face: FaceMesh, take: Take) -> list[str]:
    """Draws the face in up to three frames; none if the take holds no motion of the mesh itself.

    The lips are farthest apart in one, nearest between two openings in another; in the third most
    of the face moves.
    """
    motion: Any = take.motion
    if getattr(motion, "vectors", None) is None or take.life is None:
        return []
    count = face.pieces[0].count if face.pieces else len(face.positions)
    triangles = face.triangles[(face.triangles < count).all(axis=1)]
    way = take.life.way @ np.asarray(face.matrix_world, dtype=np.float64)
    at_rest = face.positions[:count] @ way[:, :3].T + way[:, 3]
    if np.linalg.det(way[:, :3]) < 0.0:
        triangles = triangles[:, ::-1]
    shown, view = [], None
    for row in _rows(take):
        if isinstance(motion, Frames) or motion.weights is None:
            moved = motion.vectors[row][:count]
        else:
            moved = np.einsum("k,kvc->vc", motion.weights[row], motion.vectors[:, :count])
        moved = moved @ way[:, :3].T
        view = view or _view(at_rest, np.linalg.norm(moved, axis=1))
        data = picture.png(picture.draw(at_rest + moved, triangles, view, _SIZE))
        shown.append("data:image/png;base64," + base64.b64encode(data).decode())
    return shown


def _rows(take: Take) -> list[int]:
    """The frames that are drawn, the one with the widest lips first."""
    motion: Any = take.motion
    moves = (
        motion.weights
        if motion.weights is not None
        else motion.vectors.reshape(len(motion.vectors), -1)
    )
    most = int((np.asarray(moves, dtype=np.float32) ** 2).sum(axis=1).argmax())
    if take.opening is None:
        return [most]
    gap = np.asarray(take.opening)
    wide = int(gap.argmax())
    spoken = np.flatnonzero(gap > 0.5 * gap[wide])
    nearest = int(spoken[0] + gap[spoken[0] : spoken[-1] + 1].argmin())
    return list(dict.fromkeys([wide, nearest, most]))


def _view(points: np.ndarray, moved: np.ndarray) -> picture.View:
    """The view that has the moving part of the face in its middle."""
    about = points[moved > _MOVES * moved.max(initial=0.0)]
    low, high = about.min(axis=0), about.max(axis=0)
    middle, half = (low + high) / 2.0, float((high - low)[:2].max()) / 2.0
    return picture.View(float(middle[0]), float(middle[1]), half / _FILLS)
