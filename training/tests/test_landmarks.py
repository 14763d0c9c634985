"""Heads that train and measure the landmark finder: their landmarks are true, the face can be seen."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from training.corpus.mirror import permutation

pytest.importorskip("numba")

from training.landmarks import (  # noqa: E402
    adorn,
    evaluate_unseen,
    faceless_unseen,
    heads,
    stylise,
    stylise_unseen,
)
from training.landmarks.characters import character  # noqa: E402
from training.landmarks.samples import Head  # noqa: E402


def clay(number: int) -> Head:
    return character(np.random.default_rng([1, number]))


def off_surface(head: Head, marks: np.ndarray) -> np.ndarray:
    """Distance of landmarks from the nearest vertex, metres."""
    return cKDTree(head.points[np.unique(head.triangles)]).query(marks)[0]


@pytest.mark.parametrize("number", range(12))
def test_landmarks_of_a_character_lie_on_it_and_mirror_each_other(number):
    head = clay(number)
    assert np.percentile(off_surface(head, head.landmarks), 90) < 0.006
    mirrored = head.landmarks[permutation()] * [-1, 1, 1]
    apart = np.sort(np.abs(mirrored - head.landmarks)[36:48].max(axis=1))
    # At the rim of a ball over an eye one of a pair may lie on the ball and the other beside it.
    assert apart[:-2].max() < 0.01
    assert head.landmarks[36:48, 1].min() > head.landmarks[48:68, 1].max(), "eyes above the mouth"


def test_the_mouth_of_a_character_is_where_its_surface_is_raised_or_dented():
    plain = 0
    for number in range(12):
        head = clay(number)
        near = cKDTree(head.points).query(head.landmarks[60:68], k=30)[1]
        around = head.points[near] - head.points[near].mean(1, keepdims=True)
        plain += np.linalg.svd(around, compute_uv=False)[:, 2].mean() < 1e-4
    assert plain == 0


@pytest.mark.parametrize("add", [add for add, _ in heads.COSTUMES], ids=lambda add: add.__name__)
def test_what_is_stuck_on_leaves_the_face_to_be_seen(add):
    free = 0
    for number in range(8):
        head = clay(number)
        more = add(np.random.default_rng(number), head)
        assert len(more.points) > len(head.points) and more.triangles.max() < len(more.points)
        free += heads.face_is_visible(more)
    # Lenses may cover the eyes; such glasses are left out of training.
    assert free >= 3


def test_melting_takes_the_nose_away_and_its_landmarks_along():
    head = next(h for h in map(clay, range(50)) if h.landmarks[30, 2] - h.landmarks[27, 2] > 0.01)
    flat = adorn.melted(np.random.default_rng(0), head, head.landmarks[30], 0.02)
    assert flat.landmarks[30, 2] < head.landmarks[30, 2] - 0.003
    assert np.abs(flat.landmarks[36:48] - head.landmarks[36:48]).max() < 0.01


def test_unseen_kinds_are_made_by_no_code_of_training():
    unseen = {f.__name__ for f in (*stylise_unseen.WARPS, *stylise_unseen.THINGS, *faceless_unseen.KINDS)}
    modules = (stylise, adorn, heads)
    trained = {name for m in modules for name, _ in inspect.getmembers(m, inspect.isfunction)}
    assert len(unseen) == 25 and not unseen & trained


def test_an_unseen_head_says_what_changed_it_and_so_to_which_group_it_belongs():
    assert evaluate_unseen.group_of(["bent", "blocks", "cube_eyes"]) == "cut into blocks"
    assert evaluate_unseen.group_of(["bent", "eye_patch"]) == "cubes or a patch on the eyes"
    assert evaluate_unseen.group_of(["bent", "tusks"]) == "other"
    clay_faces = SimpleNamespace(ict_head=lambda rng, _: clay(3), makehuman_head=lambda rng: clay(3))
    known = {f.__name__: f for f in (*stylise_unseen.WARPS, stylise_unseen.blocks, *stylise_unseen.THINGS)}
    for number in range(8):
        rng = np.random.default_rng(number)
        head, names = stylise_unseen.unseen_head(rng, clay_faces, np.zeros((1, 100)))
        added = {name for name in names if known[name] in stylise_unseen.THINGS}
        assert 1 <= len(names) == len(set(names)) and set(names) <= set(known)
        assert (len(head.points) > len(clay(3).points)) == bool(added)


@pytest.mark.parametrize("warp", stylise_unseen.WARPS, ids=lambda warp: warp.__name__)
def test_unseen_warps_keep_landmarks_on_the_surface(warp):
    head = clay(3)
    at = cKDTree(head.points).query(head.landmarks)[1]
    riding = Head(head.points, head.triangles, head.points[at])
    moved = warp(np.random.default_rng(2), riding)
    assert np.abs(moved.landmarks - moved.points[at]).max() < 1e-9
    assert np.abs(moved.points - head.points).max() > 0.0005
