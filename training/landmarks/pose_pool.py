"""Pictures of random heads from all directions, for the network that finds a face's pose.

    python -m training.landmarks.pose_pool --data ../shared/data --runs runs/pose --count 36000

writes `pictures.npy` `[n, 4, 128, 128]` i8 (times 80), and `poses.npy` `[n, 11]` f32: 1 if there is a
face (0 if not, -1 if it turns too far from the line of sight to say), column and row from 0 to 1, log
of a tight window's half-size over this window's, the face's x and z axes in the view, 1 for MakeHuman.
"""

from pathlib import Path

import numpy as np

from training import DATA
from training.align import canonical_landmarks, similarity
from training.flags import run_command
from training.landmarks import heads, pool, render, samples
from training.landmarks.faceless import faceless

HEADS_SHARE = 16
"""Number of pictures of each head."""
FACELESS = 0.12
"""Share of heads that are replaced by a thing without a face."""
VISIBLE, UNSURE = np.cos(np.radians(58.0)), np.cos(np.radians(75.0))
QUANTUM = 80.0


def any_rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation, uniform over all rotations."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def pose_of(landmarks: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotation (rows: face axes), centre and scale that bring canonical landmarks to these: p = s·Rᵀq + c."""
    mean = canonical_landmarks()
    weight = np.r_[np.full(17, 0.3), np.ones(51)]
    fit = similarity(mean, landmarks, weight / weight.sum())
    return fit.rotation.T, fit(mean.mean(0)[None])[0], float(fit.scale)


def view_of(rng: np.random.Generator, front: np.ndarray) -> np.ndarray:
    """A rotation for a picture: uniformly random, or (65 %) with the face roughly towards the viewer."""
    turn = any_rotation(rng)
    if rng.random() < 0.35:
        return turn
    z = np.array([0, 0, 1.0]) + rng.normal(0, rng.choice([0.15, 0.6]), 3)
    y = rng.normal(size=3)
    z /= np.linalg.norm(z)
    x = np.cross(y, z)
    x /= np.linalg.norm(x)
    toward = np.stack([x, np.cross(z, x), z], 1)
    return toward @ front


def window_of(rng, points, triangles, centre, size) -> tuple[np.ndarray, float]:
    """A window over the whole mesh, or a square with the face somewhere in it, at 1 to 8 times its size."""
    tight = pool.NOMINAL_HALF_SIZE_M * size
    if rng.random() < 0.3:
        used = points[triangles.ravel()][:, :2]
        low, high = used.min(0), used.max(0)
        return 0.5 * (low + high), 0.53 * max(high - low)
    half = tight * np.exp(rng.choice([rng.normal(0.05, 0.15), rng.uniform(-0.1, np.log(8))]))
    room = max(half - 0.6 * tight, 0.12 * tight)
    return centre[:2] + rng.uniform(-room, room, 2), half


def picture(rng, head, pose) -> tuple[np.ndarray, np.ndarray]:
    """One picture and the first ten numbers of its pose."""
    face, centre, size = pose
    turn = view_of(rng, face)
    points = head.points @ turn.T
    centre, face = turn @ centre, face @ turn.T
    middle, half = window_of(rng, points, head.triangles, centre, size)
    place = render.to_window(centre, middle, half)
    towards = face[2, 2]
    there = 1.0 if towards > VISIBLE else (-1.0 if towards > UNSURE else 0.0)
    log_size = np.log(pool.NOMINAL_HALF_SIZE_M * size / half)
    if not ((place > 0) & (place < 1)).all() or log_size < np.log(1 / 14):
        there = -1.0 if towards > UNSURE else 0.0
    drawn = render.picture(points, head.triangles, middle, half)
    return drawn, np.r_[there, place, log_size, face[0], face[2]].astype(np.float32)


def main(data: Path = DATA, runs: Path = Path("runs/pose"), count: int = 36000, seed: int = 0) -> None:
    """Entry of the command."""
    runs.mkdir(parents=True, exist_ok=True)
    faces, chosen = samples.Faces(data), pool.identities(held_out=False)
    shape = (count, 4, render.RESOLUTION, render.RESOLUTION)
    pictures = np.lib.format.open_memmap(runs / "pictures.npy", "w+", np.int8, shape)
    poses = np.zeros((count, 11), np.float32)
    for i in range(count):
        rng = np.random.default_rng([seed, 7, i])
        if i % HEADS_SHARE == 0:
            empty, is_makehuman = rng.random() < FACELESS, rng.random() < pool.MAKEHUMAN_SHARE
            head = faceless(rng) if empty else heads.random_head(rng, faces, chosen, float(is_makehuman))
            pose = (np.eye(3), np.zeros(3), 1.0) if empty else pose_of(head.landmarks)
        drawn, pose_here = picture(rng, head, pose)
        pictures[i] = np.clip(np.round(drawn * QUANTUM), -127, 127)
        poses[i] = np.r_[pose_here, float(is_makehuman)]
        poses[i, 0] = 0.0 if empty else poses[i, 0]
        if i % 2000 == 1999:
            np.save(runs / "poses.npy", poses[: i + 1])
            print(i + 1, flush=True)
    pictures.flush()
    np.save(runs / "poses.npy", poses)


if __name__ == "__main__":
    run_command(main)
