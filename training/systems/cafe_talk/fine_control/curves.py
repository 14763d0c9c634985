"""Draws a unit's weight under four β, and the lips with and without lower events, in one picture.

It repeats the paper's figure 10 with the `anyface` command:

    python -m training.systems.cafe_talk.fine_control.curves \
        --anyface target/release/anyface --audio SOUND --out CURVES.png
"""

from pathlib import Path

import matplotlib

from training.engine import Engine
from training.flags import run_command

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

# The unit of the upper picture, the shape that it moves, and the factors on the model's own β.
UNIT, SHAPE, FACTORS = "12", "mouthSmileLeft", (0.5, 1.0, 1.5, 2.0)
# Lower events of the lower picture.
LOWER = {"smile": "12,6", "jaw drop": "26"}
# Landmarks of the inner lips, in the middle.
UPPER_LIP, LOWER_LIP = 62, 66
MM = 1000.0
SLOT_S = (1.0, 2.2)
"""Start and end of the event in seconds."""
# No random motion.
STILL = ("--blinks", "0", "--brow-accents", "0", "--fps", "50")


def motion(anyface: Path, audio: Path, *more: str) -> dict[str, np.ndarray]:
    """The arrays of `anyface motion --system cafe-talk`."""
    return Engine(anyface).run("motion", "--system", "cafe-talk", "--audio", audio, *STILL, *more)


def weight(arrays: dict[str, np.ndarray], shape: str) -> np.ndarray:
    """The weight of a shape over time, [T]."""
    return arrays["weights"][:, arrays["names"].tolist().index(shape)]


def opening(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """How much farther apart the lips are than at rest, [T] mm."""
    moved = arrays["landmark_displacements"]
    return MM * (moved[:, UPPER_LIP, 1] - moved[:, LOWER_LIP, 1])


def draw(audio: Path, out: Path, anyface: Path = Path("target/release/anyface")) -> None:
    """Draws both pictures, one below the other, and marks the slot of the event."""
    figure, (above, below) = pyplot.subplots(2, 1, figsize=(8.8, 5.6), sharex=True, layout="constrained")
    plain, at = motion(anyface, audio), "{:g}-{:g}".format(*SLOT_S)
    time = np.arange(len(plain["weights"])) / plain["fps"]
    above.plot(time, weight(plain, SHAPE), color="0.3", label="no event")
    for factor, colour in zip(FACTORS, pyplot.get_cmap("viridis")(np.linspace(0.8, 0.1, 4)), strict=True):
        controlled = motion(anyface, audio, "--event", f"{at}:{UNIT}", "--event-strength", f"{factor}")
        above.plot(time, weight(controlled, SHAPE), color=colour, label=f"β times {factor:g}")
    above.set(ylabel=f"{SHAPE} under unit {UNIT}")
    below.plot(time, opening(plain), color="0.3", label="no event")
    for name, units in LOWER.items():
        below.plot(
            time,
            opening(motion(anyface, audio, "--event", f"{at}:{units}")),
            label=name,
        )
    below.axhline(0.0, color="0.7", linewidth=0.8)
    below.set(xlabel="seconds", ylabel="lips apart, mm over rest")
    for axes in (above, below):
        axes.axvspan(*SLOT_S, color="0.93", zorder=0)
        axes.margins(x=0)
        axes.legend(loc="upper right", fontsize=8)
    figure.savefig(out, dpi=100)
    pyplot.close(figure)


if __name__ == "__main__":
    run_command(draw)
