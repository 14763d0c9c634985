"""Never a silent "nothing moved": what to say when the face stays where it is."""

import numpy as np

from .errors import AnyfaceError
from .take import Sound

# Below this nobody sees a face move.
VISIBLE_MM = 0.05
# Lips move by up to 0.9 mm under noise, hiss and clicks, and by 4.8 mm under a spoken sentence,
# also a hundred times quieter (measured with the default weights).
SPOKEN_MM = 1.0
# An artist who turns speech off wants no lips to move.
_NO_ARTICULATION = 0.05
_LIPS = slice(48, 68)
# Below this a take holds room noise at most.
SILENT_DB = -60.0


def check_moved(largest_mm: float, sound: Sound, intensity: float) -> None:
    """Raises `AnyfaceError("nothing_moved")` with the likely reason.

    `largest_mm` is the largest displacement of any vertex in any frame.
    """
    if not np.isfinite(largest_mm):
        raise AnyfaceError("internal", "the result holds values that are not numbers")
    if largest_mm >= VISIBLE_MM:
        return
    raise AnyfaceError(
        "nothing_moved",
        f"nothing moved (largest motion {largest_mm:.3f} mm): {_reason(sound, intensity)}",
    )


def speech_mm(displacements: np.ndarray) -> float:
    """How far any lip landmark gets from where it mostly is, in mm.

    `displacements` `[T, 68, 3]` in metres. Blinks, brows and a lasting expression do not count.
    """
    lips = displacements[:, _LIPS]
    away = np.linalg.norm(lips - np.median(lips, axis=0), axis=2)
    return 1000.0 * float(away.max(initial=0.0))


def check_spoken(moved_mm: float | None, sound: Sound, articulation: float) -> None:
    """Raises `AnyfaceError("nothing_moved")` where only blinks and brows move.

    Lips that hear noise tremble by less than `SPOKEN_MM` times the articulation.
    """
    if moved_mm is None or articulation < _NO_ARTICULATION:
        return
    if moved_mm < SPOKEN_MM * articulation:
        raise AnyfaceError(
            "nothing_moved",
            f"nothing moved but lids and brows: {_reason(sound, 1.0)}; choose the sound with the "
            "voice, or record it louder",
        )


def check_sound(sound: Sound) -> None:
    """Raises `AnyfaceError("audio")` for a sound from which no speech can come."""
    if len(sound.samples) == 0:
        raise AnyfaceError("audio", f"{sound.name}: the part that is used holds no samples")
    if not np.isfinite(sound.samples).all():
        raise AnyfaceError("audio", f"{sound.name}: holds samples that are not numbers")
    if peak_db(sound) < SILENT_DB:
        raise AnyfaceError(
            "nothing_moved",
            f"nothing would move: {sound.name} is silent where it is used "
            f"({_level(sound)}, {sound.duration_s:.2f} s)",
        )


def peak_db(sound: Sound) -> float:
    """The peak in dB below full scale."""
    peak = float(np.abs(sound.samples).max(initial=0.0))
    return 20.0 * float(np.log10(max(peak, 1e-10)))


def _reason(sound: Sound, intensity: float) -> str:
    level = peak_db(sound)
    if level < -40.0:
        return f"{sound.name} is very quiet ({_level(sound)})"
    if intensity == 0.0:
        return f"no speech was heard in {sound.name} ({_level(sound)}) and the emotion is off"
    return f"no speech was heard in {sound.name} ({_level(sound)})"


def _level(sound: Sound) -> str:
    level = peak_db(sound)
    return "no signal at all" if level < -150.0 else f"peak {level:.0f} dB"
