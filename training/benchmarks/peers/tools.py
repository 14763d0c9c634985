"""Fetches the peers from PyPI and npm and runs them on the recordings."""

import json
import os
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile

from training.benchmarks.peers import browser
from training.benchmarks.peers.fit import at_frames
from training.benchmarks.peers.recordings import Recording
from training.corpus.tracks import SOUND_HZ

HERE = Path(__file__).parent
SHAPES = "ABCDEFGHX"
CUES_HZ = 100
BROWSER_LIMIT_S = 3600.0


@dataclass(frozen=True)
class Tool:
    """A peer in one mode: its folder of outputs, its row, its package, and which outputs the map sees."""

    key: str
    row: str
    package: str
    licence: str
    outputs: str


TOOLS = (
    Tool("openfacefx", "openfacefx, sound", "openfacefx==0.24.0 (PyPI)", "MIT",
         "`generate_from_energy`, 15 visemes at 60 fps: the way of the tool where there is no text"),
    Tool("openfacefx_text", "openfacefx, text", "openfacefx==0.24.0 (PyPI)", "MIT",
         "`generate_from_alignment`, 15 visemes at 60 fps, from the phones of the true text, timed by "
         "pocketsphinx"),
    Tool("pylipsync", "pylipsync", "pylipsync==0.2.1 (PyPI)", "MIT",
         "`extract_phoneme_segments`, 6 targets at 60 fps, as it comes"),
    Tool("headaudio", "headaudio", "@met4citizen/headaudio@0.1.0 (npm)", "MIT",
         "15 viseme weights of `update` at 60 fps, `model-en-mixed`, in an offline context of Chromium"),
    Tool("wlipsync", "wlipsync", "wlipsync@1.3.1 (npm)", "MIT",
         "6 weights, the volume and their products, in an offline context of Chromium; the package brings no "
         "profile of a voice, so it gets the one of pylipsync, which counts the same features"),
    Tool("wawa_lipsync", "wawa-lipsync", "wawa-lipsync@0.0.2 (npm)", "MIT",
         "the viseme of `processAudio` at 60 fps, as 15 zeros and ones, in an offline context of Chromium"),
    Tool("rhubarb", "Rhubarb", "rhubarb-lip-sync-wasm@0.1.8 (npm)", "MIT",
         "the mouth shape of Rhubarb Lip Sync as nine zeros and ones, in Node, from sound and the "
         "true text; the port offers its recogniser for English alone, so Mandarin is left out"),
)  # fmt: skip
PYPI = sorted({t.package.split(" ")[0] for t in TOOLS if "(PyPI)" in t.package})
NPM = sorted({t.package.split(" ")[0] for t in TOOLS if "(npm)" in t.package})


def hear(work: Path, recordings: list[Recording]) -> dict[str, str]:
    """Runs all tools on the recordings that they have no outputs for. Returns the errors by runner."""
    write_sounds(recordings, work / "sounds")
    ways = {"Python": run_python, "Chromium": run_browser, "Rhubarb": run_rhubarb}
    errors = {}
    for name, run in ways.items():
        print(f"{name} …", flush=True)
        try:
            run(work, recordings)
        except (RuntimeError, OSError, subprocess.CalledProcessError) as error:
            errors[name] = str(error)
            print(error, flush=True)
    return errors


def write_sounds(recordings: list[Recording], folder: Path) -> None:
    """Writes `<name>.wav` (16 bits), `phones.json` (rows of start, duration and label) and `texts.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    for r in recordings:
        soundfile.write(folder / f"{r.name}.wav", r.samples, SOUND_HZ, subtype="PCM_16")
    phones = {r.name: [(p.start_s, p.duration_s, p.label) for p in r.phones] for r in recordings}
    (folder / "phones.json").write_text(json.dumps(phones))
    (folder / "texts.json").write_text(json.dumps({r.name: r.text for r in recordings if r.text}))


def lacks(work: Path, tool: str, recordings: list[Recording]) -> bool:
    """Whether a tool's outputs are missing for some of the recordings."""
    return not all((work / "outputs" / tool / f"{r.name}.npz").exists() for r in recordings)


def run_python(work: Path, recordings: list[Recording]) -> None:
    """Runs the PyPI peers in an environment of their own."""
    python = environment(work)
    if lacks(work, "pylipsync", recordings):
        clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        line = [python, HERE / "packaged_python.py", work / "sounds", work / "outputs"]
        subprocess.run(line, check=True, env=clean)


def environment(work: Path) -> Path:
    """The Python that has the packages; creates its environment if it is missing."""
    place = work / "python"
    python = place / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    if not python.exists():
        venv.create(place, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PYPI], check=True)
    return python


def install_npm(work: Path) -> Path:
    """The folder that has the npm packages; installs them if they are missing."""
    place = work / "npm"
    if not (place / "node_modules/rhubarb-lip-sync-wasm").exists():
        place.mkdir(parents=True, exist_ok=True)
        subprocess.run(["npm", "install", "--silent", "--prefix", place, *NPM], check=True)
    return place


def run_browser(work: Path, recordings: list[Recording]) -> None:
    """Runs the npm peers that need a browser."""
    install_npm(work)
    if any(lacks(work, tool, recordings) for tool in browser.TOOLS):
        profile = profile_of_pylipsync(environment(work))
        browser.run_browser(work, [r.name for r in recordings], profile, BROWSER_LIMIT_S)


def profile_of_pylipsync(python: Path) -> dict:
    """The voice profile of pylipsync, for wLipSync, whose package has none.

    Both compute twelve cepstral coefficients over 64 ms as uLipSync does.
    """
    where = "import pathlib, pylipsync; print(pathlib.Path(pylipsync.__file__).parent)"
    folder = subprocess.run([python, "-c", where], check=True, capture_output=True, text=True).stdout.strip()
    phonemes = json.loads((Path(folder) / "phonemes/template.json").read_text())["phonemes"]
    mfccs = [
        {"name": name, "mfccCalibrationDataList": [{"array": row} for row in rows]}
        for name, rows in phonemes.items()
    ]
    return {"targetSampleRate": SOUND_HZ, "sampleCount": 1024, "melFilterBankChannels": 26, "mfccNum": 12,
            "compareMethod": 2, "mfccDataCount": 1, "useStandardization": True, "mfccs": mfccs}  # fmt: skip


def run_rhubarb(work: Path, recordings: list[Recording]) -> None:
    """Runs Rhubarb in Node on recordings with a text."""
    packages, english = install_npm(work), [r for r in recordings if r.text]
    if lacks(work, "rhubarb", english):
        line = ["node", HERE / "rhubarb.mjs", packages, work / "sounds", work / "cues"]
        subprocess.run(line, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        (work / "outputs/rhubarb").mkdir(parents=True, exist_ok=True)
        for r in english:
            cues = json.loads((work / "cues" / f"{r.name}.json").read_text())
            times_s, values = shapes(cues, len(r.samples) / SOUND_HZ)
            np.savez(work / "outputs/rhubarb" / f"{r.name}.npz", times_s=times_s, values=values)


def shapes(cues: list[dict], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Times [N] and which of nine mouth shapes is on at each, [N, 9]. If cues overlap, the later counts."""
    times_s = np.arange(int(seconds * CUES_HZ) + 1) / CUES_HZ
    values = np.zeros((len(times_s), len(SHAPES)))
    for cue in cues:
        inside = (times_s >= cue["start"]) & (times_s < cue["end"])
        values[inside] = np.arange(len(SHAPES)) == SHAPES.index(cue["value"])
    return times_s, values


def read_outputs(work: Path, tool: str, recordings: list[Recording]) -> dict[str, np.ndarray]:
    """Outputs of a tool at 25 fps, [T, K] by recording; recordings without outputs are left out."""
    outputs = {}
    for r in recordings:
        path = work / "outputs" / tool / f"{r.name}.npz"
        if path.exists():
            with np.load(path) as file:
                outputs[r.name] = at_frames(file["times_s"], file["values"], len(r.truth))
    return outputs
