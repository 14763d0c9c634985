"""Solves for the controls of a rig on numbers whose answer is known."""

import numpy as np
import pytest


@pytest.fixture
def solver(addon):
    """The module under test."""
    return addon("core.controls_solve")


def last(steps):
    """Runs a solver to its end and gives its return value."""
    while True:
        try:
            next(steps)
        except StopIteration as ended:
            return ended.value


def task(solver, target, controls, low=-10.0, high=10.0, **more):
    """A task in which all points have the same weight."""
    every = np.ones(target.shape[1])
    return solver.Task(target, every, np.full(controls, low), np.full(controls, high), **more)


def waves(frames, controls, seed=0):
    """Smooth values between -1 and 1."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, 2 * np.pi, frames)[:, None]
    return np.sin(time * random.uniform(0.5, 3.0, controls) + random.uniform(0, 6, controls))


def test_a_motion_that_the_controls_make_is_found_again(solver):
    directions = np.random.default_rng(1).normal(size=(5, 40, 3))
    true = waves(60, 5)
    target = np.tensordot(true, directions, axes=1)
    response = solver.Response.linear(directions)
    solution = last(solver.solve(response, task(solver, target, 5)))
    assert np.abs(solution - true).max() < 0.06
    assert solver.share_shown(target, response.at(solution)) > 0.999


def test_limits_hold_and_the_others_make_up_for_them(solver):
    random = np.random.default_rng(2)
    directions = random.normal(size=(3, 30, 3))
    # The third control does nearly the same as the first and can go on past the first's limit.
    directions[2] = directions[0] + 0.05 * random.normal(size=(30, 3))
    target = np.tensordot(np.abs(waves(50, 3)) * [1.0, 1.0, 0.0], directions, axes=1)
    problem = task(solver, target, 3, low=0.0)
    problem.highest = np.array([0.5, 10.0, 10.0])
    response = solver.Response.linear(directions)
    solution = last(solver.solve(response, problem))
    assert solution.min() >= 0.0 and solution[:, 0].max() <= 0.5 and solution[:, 2].max() > 0.3
    assert solver.share_shown(target, response.at(solution)) > 0.99


def test_controls_that_do_nearly_the_same_do_not_fight(solver):
    random = np.random.default_rng(3)
    one = random.normal(size=(1, 30, 3))
    directions = np.concatenate([one, one + 0.01 * random.normal(size=one.shape)])
    noisy = np.tensordot(waves(80, 1), one, axes=1) + 0.3 * random.normal(size=(80, 30, 3))
    flat = directions.reshape(2, -1)
    unheld = noisy.reshape(80, -1) @ np.linalg.pinv(flat)
    solution = last(solver.solve(solver.Response.linear(directions), task(solver, noisy, 2)))
    assert np.abs(unheld).max() > 5.0 and np.abs(solution).max() < 1.5
    assert np.abs(solution.sum(axis=1) - waves(80, 1)[:, 0]).max() < 0.1


def turn(points, angle):
    """Points turned about x."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T


def jaw(solver, points, knots):
    """A jaw that turns all points, and a lip bone on it that shifts half of them along y."""
    shift = np.zeros_like(points)
    shift[: len(points) // 2, 1] = 1.0
    motion = np.stack([turn(points, angle) - points for angle in knots])
    lips = np.stack([turn(shift, angle) for angle in knots])
    turning = np.stack([turn(points, k + 1e-4) - turn(points, k - 1e-4) for k in knots]) / 2e-4
    return solver.Response(np.stack([turning, lips], axis=1), motion, np.array(knots), 0)


def test_the_second_pass_follows_a_jaw_that_turns(solver):
    points = np.random.default_rng(4).normal(size=(40, 3)) * 0.1 + [0, -0.1, 0]
    angles, shifts = 0.45 * (1 - np.cos(np.linspace(0, 6.28, 50))) / 2, waves(50, 1)[:, 0] * 0.02
    lips = np.zeros_like(points)
    lips[:20, 1] = 1.0
    both = zip(angles, shifts, strict=True)
    target = np.stack([turn(points + s * lips, a) - points for a, s in both])
    response = jaw(solver, points, [0.0, 0.25, 0.5])
    first = solver.Response.linear(response.directions[0])
    problem = task(solver, target, 2)
    coarse = last(solver.solve(first, problem))
    fine = last(solver.solve(response, problem, coarse))
    misses = []
    for values in (coarse, fine):
        shown = np.stack([turn(points + s * lips, a) - points for a, s in values])
        misses.append(1.0 - solver.share_shown(target, shown))
    assert misses[1] < 0.5 * misses[0] and misses[1] < 2e-3


def test_the_gap_of_the_lips_counts_besides(solver):
    random = np.random.default_rng(5)
    directions = random.normal(size=(4, 50, 3))
    target = random.normal(size=(30, 50, 3)) * 0.2 + np.tensordot(waves(30, 4), directions, 1)
    pairs = np.array([[0, 1], [2, 3]])
    response, missed = solver.Response.linear(directions), []
    for gap in (0.0, 200.0):
        solution = last(solver.solve(response, task(solver, target, 4, pairs=pairs, gap=gap)))
        wrong = response.at(solution) - target
        missed.append(np.abs(wrong[:, pairs[:, 0]] - wrong[:, pairs[:, 1]]).mean())
    assert missed[1] < 0.8 * missed[0]


def test_a_nod_is_rigid_and_a_jaw_is_not(solver):
    points = np.random.default_rng(6).normal(size=(60, 3))
    nod = np.cross([0.01, 0.0, 0.0], points) + np.array([0.0, 0.02, 0.0])
    half = nod * (points[:, 2:] < 0.0)
    turns = solver.rigid_motions(points)
    assert solver.share_in(turns, nod) > 0.999 and solver.share_in(turns, half) < 0.9


def test_misses_are_told_by_region(solver):
    target = np.zeros((3, 4, 3))
    shown = target.copy()
    shown[1, 0, 0], shown[2, 3, 1] = 2.0, -3.0
    misses = solver.largest_misses(target, shown, np.array([0, 0, 2, 2]), ["mouth", "jaw", "eyes"])
    assert misses == {"mouth": 2.0, "eyes": 3.0}
