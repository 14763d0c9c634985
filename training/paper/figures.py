"""Figures 6 and 7 of the FreeTalk paper: decoder errors on the surface, and attention to a landmark."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot
from matplotlib.collections import PolyCollection

from training.corpus.folder import CorpusFolder
from training.corpus.topology import read_obj
from training.engine import Engine
from training.paper.tables import DECODERS, LIPS, MM, spoken_meshes

SHOWN_LANDMARKS = {8: "chin", 54: "corner of the mouth", 62: "upper lip", 66: "lower lip", 19: "brow"}


def draw(folder: CorpusFolder, engine: Engine, place: Path, images: Path) -> list[tuple[Path, str]]:
    """Draws both figures from the first held-out clip with vertices. Returns each file with its text.

    Returns an empty list if there is no such clip.
    """
    clip = next(spoken_meshes(folder, 1, place), None)
    if clip is None:
        return []
    images.mkdir(parents=True, exist_ok=True)
    _, triangles = read_obj(clip.mesh)
    motion, neutral = clip.truth[:, clip.landmarks] / clip.unit_m, clip.neutral[clip.landmarks] / clip.unit_m
    widest = int(np.linalg.norm(clip.truth, axis=-1).mean(1).argmax())
    frame = slice(widest, widest + 1)
    errors = {}
    for name, more in DECODERS.items():
        predicted = engine.spread(motion[frame], neutral, clip.mesh, clip.marks, *more)
        errors[name] = MM * np.linalg.norm(clip.unit_m * predicted[0] - clip.truth[widest], axis=-1)
    shape = clip.neutral + clip.truth[widest]
    first = images / "decoder_errors.png"
    draw_faces(first, shape, triangles, errors, "distance from the truth, mm", 3.0)
    shares = engine.attention(motion[frame], neutral, clip.mesh, clip.marks)
    columns = {name: shares[:, n] for n, name in SHOWN_LANDMARKS.items()}
    titles = {f"{name}\nat most {share.max():.2f}": share for name, share in columns.items()}
    second = images / "attention.png"
    highest = max(map(np.max, columns.values()))
    draw_faces(second, shape, triangles, titles, "share of a vertex's attention", highest)
    return [(first, ""), (second, attention_in_numbers(shares))]


def attention_in_numbers(shares: np.ndarray) -> str:
    """Sentences that say how far the vertices' attention [V, 68] is from equal shares."""
    shares = shares[shares.sum(1) > 0.5]
    entropy = -(shares * np.log(np.maximum(shares, 1e-12))).sum(1)
    count, largest = np.median(np.exp(entropy)), np.median(shares.max(1))
    total = shares.shape[1]
    return (
        f"The colours of figure 7 have one scale that begins at 0. Equal shares would be {1 / total:.3f} "
        f"everywhere. The median vertex attends to {count:.1f} of {total} landmarks (e to the entropy of "
        f"its shares) and gives {largest:.2f} to the first of them. No vertex gives more than "
        f"{shares[:, LIPS].max():.2f} to a landmark of the lips."
    )


def draw_faces(path: Path, shape: np.ndarray, triangles: np.ndarray, values: dict[str, np.ndarray],
               label: str, highest: float) -> None:  # fmt: skip
    """Draws a front view for each of the `values`, [V] each, painted from back to front."""
    figure, places = pyplot.subplots(1, len(values), figsize=(2.6 * len(values), 3.2), layout="constrained")
    corners = shape[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0
    order = np.flatnonzero(facing)[np.argsort(corners[facing].mean(1)[:, 2])]
    for axes, (name, value) in zip(np.atleast_1d(places), values.items(), strict=True):
        shown = PolyCollection(corners[order][..., :2], array=value[triangles[order]].mean(1), cmap="turbo")
        shown.set(clim=(0, highest), edgecolor="face", linewidth=0.2)
        axes.add_collection(shown)
        axes.set(title=name, xlim=np.ptp(shape[:, 0]) * np.array([-0.55, 0.55]) + shape[:, 0].mean(),
                 ylim=(shape[:, 1].min(), shape[:, 1].max()))  # fmt: skip
        axes.set_aspect("equal")
        axes.axis("off")
    figure.colorbar(shown, ax=places, label=label, shrink=0.7)
    figure.savefig(path, dpi=90)
    pyplot.close(figure)
