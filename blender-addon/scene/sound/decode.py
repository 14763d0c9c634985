"""Decodes sound files with the library's decoder, or with Blender's if that fails."""

import numpy as np

from ...core.errors import AnyfaceError
from ...core.source import Decode


def decoder(engine) -> Decode:
    """A decoder that tries both. Any thread may call it."""

    def decode(path: str) -> tuple[np.ndarray, float, str]:
        try:
            return engine.decode(path)
        except AnyfaceError as error:
            # Blender's decoder returns half of a damaged file without an error, so it is not asked.
            if error.kind != "audio" or engine.is_damaged(path):
                raise
            try:
                return (*decode_with_aud(path), "")
            except Exception:
                # Blender 4.5 raises any kind of exception for a sound without samples. The
                # library's error says what is wrong.
                raise error from None

    return decode


def decode_with_aud(path: str) -> tuple[np.ndarray, float]:
    """Decodes with Blender's decoder (FFmpeg), which also reads the sound of films.

    The channels are averaged; `rechannel(1)` would sum them and clip. Raises `ImportError` if
    Blender runs as a Python module without `aud`. Raises `OSError` if Blender cannot read the file
    or the file has no samples.
    """
    import aud

    try:
        sound = aud.Sound(path)
        rate_hz = float(sound.specs[0])
        samples = np.asarray(sound.data(), dtype=np.float32)
    except aud.error as error:
        raise OSError(f"{path}: {error}") from None
    if len(samples) == 0 or not rate_hz > 0.0:
        raise OSError(f"{path}: {len(samples)} samples at {rate_hz:g} Hz")
    return samples.reshape(len(samples), -1).mean(axis=1, dtype=np.float32), rate_hz
