"""Runs the peers from PyPI in an environment that has their packages but not ours.

    python packaged_python.py SOUNDS OUT

SOUNDS holds `<name>.wav` (16 bits, 16 kHz) and `phones.json`. For some names that file has rows of start and
duration in seconds and ARPABET label. OUT gets `<tool>/<name>.npz` with `times_s` [N] and `values` [N, K].
"""

import json
import sys
from pathlib import Path

import numpy as np
import soundfile
from openfacefx import generate_from_alignment
from openfacefx.aligners_acoustic import from_phone_timestamps
from openfacefx.energy import generate_from_energy
from openfacefx.visemes import VISEMES
from pylipsync import PhonemeAnalyzer

FPS = 60


def track_values(track, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Interpolates the keys of OpenFaceFX's channels linearly at 60 fps: times [N] and weights [N, 15]."""
    times_s = np.arange(int(seconds * FPS) + 1) / FPS
    values = np.zeros((len(times_s), len(VISEMES)))
    for channel in track.channels:
        keys = [(key.time, key.value) for key in channel.keys]
        values[:, list(VISEMES).index(channel.name)] = np.interp(times_s, *zip(*keys, strict=True))
    return times_s, values


def main(sounds: Path, out: Path) -> None:
    """Runs all tools on all sounds."""
    phones = json.loads((sounds / "phones.json").read_text())
    analyzer = PhonemeAnalyzer()
    for path in sorted(sounds.glob("*.wav")):
        samples, rate_hz = soundfile.read(path, dtype="float32")
        seconds = len(samples) / rate_hz
        outputs = {"openfacefx": track_values(generate_from_energy(str(path)), seconds)}
        if phones.get(path.stem):
            segments = from_phone_timestamps(phones[path.stem], alphabet="arpabet", timing="start_dur")
            outputs["openfacefx_text"] = track_values(generate_from_alignment(segments), seconds)
        steps = analyzer.extract_phoneme_segments(samples, rate_hz, return_seconds=True)
        outputs["pylipsync"] = (
            np.array([0.5 * (step.start + step.end) for step in steps]),
            np.array([[phoneme.target for phoneme in step.phonemes] for step in steps]),
        )
        for tool, (times_s, values) in outputs.items():
            (out / tool).mkdir(parents=True, exist_ok=True)
            np.savez(out / tool / f"{path.stem}.npz", times_s=times_s, values=values)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
