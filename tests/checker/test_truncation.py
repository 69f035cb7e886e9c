"""Each ratio of the law of truncation by itself, on a body in free fall that spins about an axis of inertia."""

import numpy as np
import pytest

from .test_check_bundle import checker

G, SPIN, T_END, H = 10.0, 2.0, 1.0, 0.01  # [m/s^2], [rad/s], [s], [s]
SIZES = {"body": 1, "user": 0, "joint": 0}


def problem_of(gravity=G, kinds=(), **joints):
    """The problem of one free body, without an exact motion that could excuse an error."""
    sizes = SIZES | {"joint": len(kinds)}
    numbers = {key: np.zeros([sizes.get(axis, axis) for axis in axes]) for key, axes in checker.SHAPES.items()}
    numbers |= {"mass": np.ones(1), "inertia": np.diag([0.1, 0.2, 0.3])[None], "gyration": np.full(1, 0.6)}
    numbers |= {"gravity": np.array([0.0, 0.0, -gravity]), "start_R": np.eye(3)[None]}
    head = {"t_end_s": T_END, "literal_start": False, "not_serialised": [], "invariants": [], "joint_kinds": kinds}
    numbers |= {key: np.array(values) for key, values in joints.items()}
    head |= {"reference": {"route": "", "horizon_s": 0.0}, "numbers": {k: a.tolist() for k, a in numbers.items()}}
    return checker.Problem(head, None, "free fall")


def move(extra_velocity=0.0):
    """The exact states; velocities along x too large by a constant, which changes no quotient of velocities."""
    t = np.arange(0.0, T_END + H / 2, H)
    states = np.zeros((len(t), 20))
    states[:, 0], states[:, 3] = t, -0.5 * G * t**2
    states[:, 4:13] = checker.exp(t[:, None] * np.array([0.0, 0.0, SPIN])).reshape(-1, 9)
    states[:, 13], states[:, 15], states[:, 18] = extra_velocity, -G * t, SPIN
    return states


def find_ratio(problem, states):
    return checker.TruncationLaw(problem, states, None, speed=G * T_END, length=5.0).find_ratios()[0]


def test_the_exact_motion_keeps_the_law():
    assert find_ratio(problem_of(), move()) < 1e-6


@pytest.mark.parametrize("what", ["velocities", "accelerations"])
def test_one_ratio_finds_what_it_is_for(what):
    """Velocities that poses do not follow, with right accelerations; and a motion of another gravity."""
    right, states = problem_of(), move(0.5 * G * T_END if what == "velocities" else 0.0)
    assert find_ratio(right if what == "velocities" else problem_of(0.5 * G), states) > 1.0


PUSH, FAST = 300.0, 60.0  # [N], [rad/s]: of a load that a step of a tenth of a second does not resolve


def push(followed):
    """The law of a body that a load pushes along z, and its ratio: of its exact motion, or free fall called so."""
    problem = problem_of(
        joint_moving=[1.0],
        joint_i=[0.0],
        joint_j=[-1.0],
        joint_u=[[0.0, 0.0, 1.0]],
        joint_motion=[[0.0] * 4 + [PUSH, FAST, 0.0]],
        kinds=["load"],
    )
    states = move()[::10].copy()
    if followed:
        t = states[:, 0]
        states[:, 3] += PUSH / FAST * (t - np.sin(FAST * t) / FAST)
        states[:, 15] += PUSH / FAST * (1 - np.cos(FAST * t))
    problem.exact = states
    law = checker.TruncationLaw(problem, states, None, speed=G * T_END, length=5.0)
    with np.errstate(all="ignore"):
        return law, law.find_ratios()[0]


def test_an_exact_motion_excuses_steps_that_are_too_long():
    """Its rates are those that the equations of motion lead to, from step to step."""
    law, ratio = push(followed=True)
    assert max(law.judge_exact_motion()) > 1.0 and ratio < 1.0 and not law.doubts


def test_an_exact_motion_of_other_forces_excuses_nothing():
    """A run and an exact motion that fall freely, though a load pushes: neither breaks its own poses."""
    law, ratio = push(followed=False)
    assert law.judge_exact_motion() == (0.0, 0.0) and ratio > 1.0
