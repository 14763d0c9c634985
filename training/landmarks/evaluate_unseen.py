"""Measures the shipped finder: on stylised heads of unseen kinds, and on things that it must refuse.

    cargo build --release
    python -m training.landmarks.evaluate_unseen --data ../shared/data --anyface target/release/anyface

Heads are turned at random, scaled and moved; things without a face are turned. A region counts as right if
its landmarks lie on average within 4 % of the face's height from the truth. The height goes from the chin to
the middle of the brows.
"""

import tempfile
from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from training import DATA
from training.corpus.topology import write_obj
from training.flags import run_command
from training.landmarks import pool, pose_pool, samples
from training.landmarks.evaluate import command_of, find, placed
from training.landmarks.faceless_unseen import KINDS
from training.landmarks.stylise_unseen import unseen_head

WITHIN = 0.04
REGIONS = {"mouth": slice(48, 68), "eyes": slice(36, 48)}
ALL_REGIONS = REGIONS | {"brows": slice(17, 27), "nose": slice(27, 36), "jaw": slice(0, 17)}


def face_height(marks: np.ndarray) -> float:
    """Distance from the chin to the middle of the brows."""
    return float(np.linalg.norm(marks[8] - marks[[19, 24]].mean(0)))


def group_of(changes: list[str]) -> str:
    """The group of heads to which these changes of a head belong."""
    if "blocks" in changes:
        return "cut into blocks"
    return "cubes or a patch on the eyes" if {"cube_eyes", "eye_patch"} & set(changes) else "other"


def head_number(number: int, faces: samples.Faces, held_out: np.ndarray) -> tuple[samples.Head, list[str]]:
    """The unseen head with a given number, upright, and the names of its changes."""
    return unseen_head(np.random.default_rng([4242, number]), faces, held_out)


def thing_number(number: int, faces: samples.Faces, held_out: np.ndarray):
    """Points and triangles of the faceless thing with a given number, and the name of its kind."""
    make = KINDS[number % len(KINDS)]
    points, triangles = make(np.random.default_rng([4353, number]), faces, held_out)
    return points, triangles, make.__name__


def heads(anyface: list, folder: Path, faces, held_out: np.ndarray, count: int) -> None:
    """Prints the share of heads whose mouth and eyes are right, by group, and the share of right regions."""
    off = {name: [] for name in ALL_REGIONS}
    made, right, refused = Counter(), Counter(), Counter()
    for number in range(count):
        head, changes = head_number(number, faces, held_out)
        group = group_of(changes)
        made[group] += 1
        head, _ = placed(np.random.default_rng([4244, number]), head)
        landmarks = find(anyface, folder, head.points, head.triangles)
        if landmarks is None:
            refused[group] += 1
            print(f"number {number} is refused", flush=True)
            continue
        miss = np.linalg.norm(landmarks - head.landmarks, axis=1) / face_height(head.landmarks)
        for name, region in ALL_REGIONS.items():
            off[name].append(miss[region].mean())
        good = all(miss[region].mean() <= WITHIN for region in REGIONS.values())
        right[group] += good
        if number % 20 == 19:
            print(f"{number + 1} heads, {right.total()} right, {refused.total()} refused", flush=True)
        if not good:
            text = ", ".join(f"{name} {off[name][-1]:.3f}" for name in ALL_REGIONS)
            print(f"number {number} is misplaced: {text} of face height", flush=True)
    for name, values in off.items():
        share = np.sum(np.array(values) <= WITHIN) / count
        print(f"{name}: {share:.1%} within {WITHIN:.0%}, median {np.median(values):.2%} of face height")
    print(f"mouth and eyes within {WITHIN:.0%} of face height:")
    for group, number in made.items():
        print(f"{group}: {right[group]} of {number}, {refused[group]} refused")
    print(f"all heads: {right.total()} of {count}, {refused.total()} refused")


def things(anyface: list, folder: Path, faces, held_out: np.ndarray, count: int) -> None:
    """Prints how many things without a face are refused."""
    false_faces = []
    for number in range(count):
        points, triangles, name = thing_number(number, faces, held_out)
        turn = pose_pool.any_rotation(np.random.default_rng([4354, number]))
        if find(anyface, folder, points @ turn.T, triangles) is not None:
            false_faces.append(number)
            print(f"number {number}, {name}, was taken for a face", flush=True)
        if number % 20 == 19:
            print(f"{number + 1} things, {len(false_faces)} taken for faces", flush=True)
    print(f"without a face: {count - len(false_faces)} of {count} refused")


def main(
    data: Path = DATA,
    anyface: Path = Path("target/release/anyface"),
    weights: Annotated[Path | None, "a folder of models instead of the built-in ones"] = None,
    count: Annotated[int, "heads; half as many things"] = 200,
    only: Literal["heads", "things", None] = None,
    write: Annotated[Path | None, "only writes the heads, upright, as OBJ here"] = None,
) -> None:
    """Entry of the command."""
    faces, held_out = samples.Faces(data), pool.identities(held_out=True)
    if write:
        write.mkdir(parents=True, exist_ok=True)
        for number in range(count):
            head, _ = head_number(number, faces, held_out)
            write_obj(write / f"character_{number:03}.obj", head.points, head.triangles)
        return
    command = command_of(anyface, weights)
    with tempfile.TemporaryDirectory() as name:
        if only != "things":
            heads(command, Path(name), faces, held_out, count)
        if only != "heads":
            things(command, Path(name), faces, held_out, count // 2)


if __name__ == "__main__":
    run_command(main)
