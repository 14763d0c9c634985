"""Decodes sound files: the library's own decoder first, Blender's for what that cannot read."""

import numpy as np

from ...core.errors import AnyfaceError
from ...core.source import Decode


def decoder(engine) -> Decode:
    """The decoder that tries both; any thread may call it."""

    def decode(path: str) -> tuple[np.ndarray, float, str]:
        try:
            return engine.decode(path)
        except AnyfaceError as error:
            # Blender's decoder makes half a sound of a damaged file and says nothing.
            if error.kind != "audio" or engine.is_damaged(path):
                raise
            try:
                return (*decode_with_aud(path), "")
            except Exception:
                # Of a sound without samples 4.5 says so in exceptions of any kind; the library said
                # what is wrong.
                raise error from None

    return decode


def decode_with_aud(path: str) -> tuple[np.ndarray, float]:
    """Blender's decoder (FFmpeg), which also reads the sound of films.

    The channels are averaged; `rechannel(1)` would sum them and clip. Some builds of Blender as
    a Python module have no `aud`: `ImportError`. `OSError` for what it cannot read, or where
    nothing is to be heard.
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
