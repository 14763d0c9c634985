"""Renders random heads once, so that training reads pictures instead of drawing them.

    python -m training.landmarks.pool --data ../shared/data --runs runs/landmarks --count 8000

writes `pictures.npy` `[n, 4, 128, 128]` f16, `targets.npy` `[n, 68, 2]` f32 (column, row from 0 to 1
over the window), and `kind.npy` `[n]`: 0 no face, 1 ICT, 2 MakeHuman.
"""

from pathlib import Path

import numpy as np

from training import DATA
from training.align import canonical_landmarks
from training.flags import run_command
from training.landmarks import heads, render, samples
from training.landmarks.faceless import faceless
from training.landmarks.stepped import stepped

NOMINAL_HALF_SIZE_M = 0.105
IDENTITIES = 400
PICTURES_A_HEAD = 3
MAKEHUMAN_SHARE = 0.2


def identities(held_out: bool) -> np.ndarray:
    """`[n, 100]` coefficients. The held-out ones come from another random stream and are never trained on."""
    rng = np.random.default_rng(9001 if held_out else 1)
    return rng.normal(0, 1.15, (IDENTITIES, 100)).astype(np.float32)


def rotation(rng: np.random.Generator, wide: bool) -> np.ndarray:
    """Slight roll and pitch. If `wide`, the yaw is near that of one of the three views, else near 0."""
    if wide:
        turn = rng.choice([-40.0, 0.0, 40.0]) + rng.normal(0, 8)
    else:
        turn = rng.normal(0, 12)
    roll, pitch = rng.normal(0, 10, 2)
    roll, pitch, turn = np.radians([roll, pitch, turn])
    c, s = np.cos(roll), np.sin(roll)
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = np.cos(pitch), np.sin(pitch)
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return about_z @ about_x @ render.yaw(turn)


def window(rng: np.random.Generator, landmarks: np.ndarray, tight: bool) -> tuple[np.ndarray, float]:
    """Centre and half-size of a window: tight, as after a first guess, or loose, as in the search."""
    spread = np.sqrt(((landmarks - landmarks.mean(0)) ** 2).sum(1).mean())
    mean = canonical_landmarks()
    scale = spread / np.sqrt(((mean - mean.mean(0)) ** 2).sum(1).mean())
    middle = landmarks[:, :2].mean(0)
    if tight:
        half = NOMINAL_HALF_SIZE_M * scale * np.exp(rng.normal(0, 0.08))
        return middle + rng.normal(0, 0.05, 2) * half, half
    half = NOMINAL_HALF_SIZE_M * scale * np.exp(rng.uniform(0, np.log(3.2)))
    room = max(half - 0.09 * scale, 0.1 * half)
    return middle + rng.uniform(-room, room, 2), half


def softness(rng: np.random.Generator) -> float:
    """By how many pixels to soften a picture. One in five is softened, like the finder's soft looks."""
    return float(rng.uniform(1.0, 5.0)) if rng.random() < 0.2 else 0.0


def draw_face(rng, head) -> tuple[np.ndarray, np.ndarray]:
    """One picture with a face and its targets."""
    tight = rng.random() < 0.6
    turn = rotation(rng, wide=tight).T
    points, landmarks = head.points @ turn, head.landmarks @ turn
    centre, half = window(rng, landmarks, tight)
    return (
        render.picture(points, head.triangles, centre, half, softness(rng)),
        render.to_window(landmarks, centre, half),
    )


def draw_nothing(rng, faces, chosen) -> tuple[np.ndarray, np.ndarray, int]:
    """One picture without a face: a head from behind or tilted over, other shapes, or beside the face."""
    head = heads.random_head(rng, faces, chosen, 0.2)
    points, triangles = head.points, head.triangles
    kind = rng.random()
    if kind < 0.45:
        turn = render.yaw(np.radians(180 + rng.normal(0, 30)))
        if rng.random() < 0.3:
            tilt = rng.choice([90.0, 180.0, -90.0]) + rng.normal(0, 10)
            c, s = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
            turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        points = points @ turn.T
    elif kind < 0.75:
        shape = faceless(rng)
        if rng.random() < 0.2:
            shape = stepped(rng, shape)
        turn = render.yaw(rng.uniform(-np.pi, np.pi))
        points, triangles = shape.points @ turn.T, shape.triangles
    if kind < 0.75:
        centre, half = rng.normal(0, 0.02, 2), NOMINAL_HALF_SIZE_M * np.exp(rng.uniform(-0.3, 1.2))
    else:
        side = rng.choice([-1, 1], 2) * rng.uniform(0.09, 0.25, 2)
        centre, half = head.landmarks[:, :2].mean(0) + side, rng.uniform(0.04, 0.10)
    return render.picture(points, triangles, centre, half, softness(rng)), np.full((68, 2), 0.5), 0


def main(data: Path = DATA, runs: Path = Path("runs/landmarks"), count: int = 8000, seed: int = 0) -> None:
    """Draws the pool; `kind.npy` marks MakeHuman's pictures."""
    runs.mkdir(parents=True, exist_ok=True)
    faces, chosen = samples.Faces(data), identities(held_out=False)
    pictures = np.lib.format.open_memmap(
        runs / "pictures.npy", "w+", np.float16, (count, 4, render.RESOLUTION, render.RESOLUTION)
    )
    targets, kinds = np.zeros((count, 68, 2), np.float32), np.zeros(count, np.int8)
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        if i % PICTURES_A_HEAD == 0:
            kind = 2 if rng.random() < MAKEHUMAN_SHARE else 1
            head = heads.random_head(rng, faces, chosen, float(kind == 2))
        if rng.random() < 0.15:
            pictures[i], targets[i], kinds[i] = draw_nothing(rng, faces, chosen)
        else:
            pictures[i], targets[i] = draw_face(rng, head)
            kinds[i] = kind
        if i % 500 == 499:
            print(i + 1, flush=True)
    pictures.flush()
    np.save(runs / "targets.npy", targets)
    np.save(runs / "kind.npy", kinds)


if __name__ == "__main__":
    run_command(main)
