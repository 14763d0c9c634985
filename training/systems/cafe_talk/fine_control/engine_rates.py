"""Control rate of every unit (eq. 7) as the `anyface` command shows it, under four ways to make an event.

    python -m training.systems.cafe_talk.fine_control.engine_rates \\
        --anyface target/release/anyface --report docs/measured/control-rate.md

*Calibrated* is the default: after sampling, an event is put on its times and its strength. *Calibrated at
once* is the same with `--onset 0`, which keeps it within its slot. *As sampled* is
`--calibrate off`. *Printed* is `--guidance printed`: eq. 6 as the paper has it, as sampled. The sounds are
the first held-out clips of grid_s1.
"""

import tempfile
from pathlib import Path

import numpy as np
import soundfile
import torch

from training.corpus.action_units import LOWER
from training.corpus.clip import Clip
from training.corpus.conditions import UNITS
from training.corpus.faces import CHANNELS
from training.corpus.grid import read_grid
from training.engine import Engine
from training.flags import run_command
from training.systems.cafe_talk.fine_control import metrics

WAYS = {
    "calibrated": (),
    "calibrated at once": ("--onset", "0"),
    "as sampled": ("--calibrate", "off"),
    "printed": ("--guidance", "printed"),
}
SLOT_S = (1.0, 1.8)
"""The slot of the event: the middle of a clip of three seconds."""
FPS = 25
STILL = ("--fps", f"{FPS}", "--emotion", "neutral", "--blinks", "0", "--brow-accents", "0", "--variety", "0")
"""No random motion beside the event."""
PAGE = """# Control rate of Cafe-Talk's events

Eq. 7 of the paper: the largest weight of a unit in its slot, less its mean over the five frames on either side. Every
unit on both sides at strength 1, from {slot[0]:g} to {slot[1]:g} s of {clips} held-out clips of grid_s1, as the
command shows it, without blinks, brow accents and variety. Means over clips, lowest and highest clip behind them.

```
python -m training.systems.cafe_talk.fine_control.engine_rates --data ../shared/data --clips {clips} --report docs/measured/control-rate.md
```

- *calibrated*: the default. After sampling, each event rises and falls as long as its units take, and its peak is its
  strength, unless the speech alone goes beyond. So this column measures a rule, not the model. Eq. 7 subtracts
  what an event does within 0.2 s of its slot, so it punishes an event that comes and goes as on a face.
- *calibrated at once*: the same with `--onset 0`: the event stays within its slot.
- *as sampled*: `--calibrate off`, what the model and our eq. 6 make. The third term subtracts the prediction for
  the same speech without events.
- *printed*: `--guidance printed`, eq. 6 as the paper has it, as sampled. The third term subtracts the prediction
  without speech and emotion.

*Mouth* is how far an event moves the gap of the lips from where the speech has it, RMS within the slot, mm.

| | no event | {ways} |
| --- | --- | {lines} |
{rows}
"""  # noqa: E501


class Performer:
    """Performs clips with the command."""

    def __init__(self, anyface: Path, folder: Path):
        self.engine, self.folder = Engine(anyface), folder

    def weights(self, clip: Clip, *flags: str) -> tuple[np.ndarray, np.ndarray]:
        """Weights [T, 51] of a clip, and the landmarks [T, 204] in metres that they move."""
        sound = self.folder / f"{clip.name}.wav"
        if not sound.exists():
            soundfile.write(sound, clip.samples, 16000, subtype="FLOAT")
        made = self.engine.run("motion", "--system", "cafe-talk", "--audio", sound, *STILL, *flags)
        columns = [made["names"].tolist().index(name) for name in CHANNELS]
        return made["weights"][:, columns], made["landmark_displacements"].reshape(len(made["weights"]), -1)


def measure(performer: Performer, clips: list[Clip]) -> dict[str, dict[str, np.ndarray]]:
    """By unit and way, control rate and mouth's change of each clip, [clips, 2]. Way `none` has no event."""
    slot, rates = tuple(round(FPS * second) for second in SLOT_S), {}
    plain = [performer.weights(clip) for clip in clips]
    for unit in UNITS:
        rates[unit] = {"none": np.array([[rate(w, unit, slot), 0.0] for w, _ in plain])}
        for way, flags in WAYS.items():
            event = ("--event", "{:g}-{:g}:".format(*SLOT_S) + unit)
            made = [performer.weights(clip, *event, *flags) for clip in clips]
            moved = [
                mouth_mm(with_event, without, slot)
                for (_, with_event), (_, without) in zip(made, plain, strict=True)
            ]
            values = [rate(weights, unit, slot) for weights, _ in made]
            rates[unit][way] = np.stack([values, moved], axis=1)
        print(unit, *(f"{way} {each[:, 0].mean():.2f}" for way, each in rates[unit].items()), flush=True)
    return rates


def rate(weights: np.ndarray, unit: str, slot: tuple[int, int]) -> float:
    """Control rate of a unit in weights [T, 51]."""
    return metrics.control_rate(metrics.unit_values(torch.from_numpy(weights), unit), slot)


def mouth_mm(with_event: np.ndarray, without: np.ndarray, slot: tuple[int, int]) -> float:
    """RMS change of the lip gap within a slot, mm, from landmarks [T, 204] metres."""
    change = metrics.lip_gap(torch.from_numpy(with_event - without))[slice(*slot)]
    return 1e3 * float(change.square().mean().sqrt())


def page(rates: dict[str, dict[str, np.ndarray]], clips: int) -> str:
    """The measured page."""
    groups = {f"unit {unit}": [unit] for unit in UNITS}
    upper = [unit for unit in UNITS if unit not in LOWER]
    groups |= {"**upper units**": upper, "**lower units**": list(LOWER), "**all**": UNITS}
    rows = []
    for name, units in groups.items():
        cells = [f"{np.mean([rates[u]['none'][:, 0] for u in units]):.2f}"]
        for way in WAYS:
            each = np.mean([rates[u][way] for u in units], axis=0)
            low, high = each[:, 0].min(), each[:, 0].max()
            cells += [f"{each[:, 0].mean():.2f} ({low:.2f} to {high:.2f})", f"{each[:, 1].mean():.1f}"]
        rows.append(f"| {name} | {' | '.join(cells)} |")
    ways = " | ".join(f"{way} | mouth" for way in WAYS)
    lines = " | ".join(["---"] * 2 * len(WAYS))
    return PAGE.format(slot=SLOT_S, clips=clips, ways=ways, lines=lines, rows="\n".join(rows))


def report(
    report: Path, data: Path = Path("../shared/data"), clips: int = 6,
    anyface: Path = Path("target/release/anyface"),
) -> None:  # fmt: skip
    """Measures the control rates and writes the page."""
    held_out = [clip for clip in read_grid(data) if clip.held_out][:clips]
    with tempfile.TemporaryDirectory() as folder:
        rates = measure(Performer(anyface, Path(folder)), held_out)
    report.write_text(page(rates, len(held_out)), encoding="utf-8")


if __name__ == "__main__":
    run_command(report)
