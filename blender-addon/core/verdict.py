"""Explains why a face does not move, so that this never goes unsaid."""

import numpy as np

from .errors import AnyfaceError
from .take import Animation, Sound

# A sound whose peak is below this holds room noise at most.
SILENT_DB = -60.0


def check_seen(animation: Animation, sound: Sound, intensity: float) -> None:
    """Raises `AnyfaceError("nothing_moved")` with the likely reason if nobody sees the face speak.

    `intensity` is the strength of the emotion.
    """
    if not np.isfinite(animation.largest_mm):
        raise AnyfaceError("internal", "the result holds values that are not numbers")
    if animation.visibility == "NOTHING":
        text = (
            f"nothing moved by more than {animation.largest_mm:.3f} mm: {_reason(sound, intensity)}"
        )
        raise AnyfaceError("nothing_moved", text, ("choose_sound",))
    if animation.visibility == "LIPS_REST":
        raise AnyfaceError(
            "nothing_moved",
            f"nothing moved but lids and brows: {_reason(sound, 1.0)}; choose the sound with the "
            "voice, or record it louder",
            ("choose_sound",),
        )


def check_sound(sound: Sound) -> None:
    """Raises `AnyfaceError` for a sound that cannot hold speech.

    "audio" if it has no samples or some are not finite, "nothing_moved" if it is silent.
    """
    if len(sound.samples) == 0:
        raise AnyfaceError("audio", f"{sound.name}: the part that is used holds no samples")
    if not np.isfinite(sound.samples).all():
        raise AnyfaceError("audio", f"{sound.name}: holds samples that are not numbers")
    if peak_db(sound) < SILENT_DB:
        raise AnyfaceError(
            "nothing_moved",
            f"nothing would move: {sound.name} is silent where it is used "
            f"({_level(sound)}, {sound.duration_s:.2f} s)",
            ("choose_sound",),
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
