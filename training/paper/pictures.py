"""Pictures for the documents: where emotion acts, how far takes differ, and how near a head is to its scan.

python -m training.paper.pictures --audio demo-output/voice.wav --scan SCAN.obj
"""

import json
import tempfile
from pathlib import Path

import numpy as np
import soundfile
from matplotlib import pyplot
from scipy.spatial import cKDTree

from training.align import similarity
from training.corpus.topology import read_obj
from training.engine import Engine
from training.flags import run_command
from training.paper.figures import draw_faces
from training.paper.tables import MM
from training.systems.cafe_talk.fine_control.curves import opening

HEAD = Path("weights/shared/default_head")
IMAGES, ANYFACE = Path("docs/images"), Path("target/release/anyface")
EMOTIONS = ("neutral", "angry", "afraid")
SEEDS = {"facetalk": range(5), "freetalk": range(2)}
"""Seeds of each system. Every seed gives a take."""
ROUNDS, NEAR_M, SAMPLES = 20, 0.005, 20
"""How a scan is aligned to a head: number of rounds, greatest distance, and points per triangle.

Points of the scan that are at least `NEAR_M` metres from the head are ignored, because the head lacks
these parts. `SAMPLES` points on each triangle represent the head's surface.
"""


def draw_mask(engine: Engine, audio: Path, out: Path) -> None:
    """Draws Mesh Attention's w, averaged over time, on the default head, once for each emotion."""
    neutral, triangles = read_obj(HEAD / "head.obj")
    masks = {}
    with tempfile.TemporaryDirectory() as folder:
        for emotion in EMOTIONS:
            mask = Path(folder) / f"{emotion}.npz"
            engine.run("animate", "--system", "emoface", "--audio", audio, "--emotion", emotion,
                       "--mesh", HEAD / "head.obj", "--landmarks", HEAD / "landmarks.json",
                       "--mask-out", mask)  # fmt: skip
            masks[emotion] = np.load(mask)["mask"].mean(0)
    draw_faces(out, neutral, triangles, masks, "w, share of the emotion branch", 1.0)


def draw_seeds(engine: Engine, audio: Path, out: Path) -> None:
    """Draws the opening of the lips over the sound: a row for each system, a curve for each seed."""
    samples, rate = soundfile.read(audio)
    figure, rows = pyplot.subplots(len(SEEDS), 1, figsize=(8.1, 3.2), sharex=True, layout="constrained")
    for axes, (system, seeds) in zip(rows, SEEDS.items(), strict=True):
        waveform = axes.twinx()
        waveform.plot(np.arange(len(samples)) / rate, samples, color="0.85", linewidth=0.3)
        waveform.axis("off")
        axes.set(title=f"{system}, seeds 0 to {seeds[-1]}", ylabel="lips apart, mm", zorder=2, frame_on=False)
        for seed in seeds:
            take = engine.run("motion", "--system", system, "--audio", audio, "--seed", seed)
            gap = opening(take)
            axes.plot(np.arange(len(gap)) / take["fps"], gap, linewidth=1.0)
    rows[-1].set(xlabel="seconds")
    figure.savefig(out, dpi=100)
    pyplot.close(figure)


def draw_scan(engine: Engine, scan: Path, out: Path) -> None:
    """Draws how far a scan is from the head that `anyface head` finds for it.

    The head is in metres. The scan is aligned to it by landmarks, then by the nearest points of its surface.
    """
    places = {}
    with tempfile.TemporaryDirectory() as folder:
        head, marks = Path(folder) / "head.obj", Path(folder) / "scan.json"
        engine.call("head", "--like", scan, "--out", head)
        engine.call("landmarks", "--mesh", scan, "--out", marks)
        for name, file in (("head", head.with_suffix(".landmarks.json")), ("scan", marks)):
            places[name] = np.array([mark["position"] for mark in json.loads(file.read_text())["landmarks"]])
        vertices, faces = read_obj(head)
    points, triangles = read_obj(scan)
    points = similarity(places["scan"], places["head"])(points)
    shares = np.random.default_rng(0).dirichlet((1.0, 1.0, 1.0), (len(faces), SAMPLES))
    surface = np.einsum("fsk,fkx->fsx", shares, vertices[faces]).reshape(-1, 3)
    tree = cKDTree(surface)
    for _ in range(ROUNDS):
        distance, nearest = tree.query(points)
        near = distance < NEAR_M
        points = similarity(points[near], surface[nearest[near]])(points)
    distance = MM * tree.query(points)[0]
    # Leave out the shoulders of the scan, because the head has none.
    triangles = triangles[(points[triangles][..., 1] > vertices[:, 1].min()).all(1)]
    used, triangles = np.unique(triangles, return_inverse=True)
    draw_faces(out, points[used], triangles.reshape(-1, 3), {"a scan": distance[used]}, "mm to the head", 4.0)


def draw(audio: Path, scan: Path, out: Path = IMAGES, anyface: Path = ANYFACE) -> None:
    """Draws all three pictures."""
    engine = Engine(anyface)
    draw_mask(engine, audio, out / "emoface-mask.png")
    draw_seeds(engine, audio, out / "facetalk/seeds.png")
    draw_scan(engine, scan, out / "facetalk/scan.png")


if __name__ == "__main__":
    run_command(draw)
