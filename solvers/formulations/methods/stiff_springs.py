"""The message of a march that is stuck because its iteration ignores springs: the step with which it would converge."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy.linalg as sl

from ....harness.mechanics import so3
from ....harness.mechanics.jacobian import constraint_jacobian
from ....harness.mechanics.motion import applied_loads
from ....harness.mechanics.state import State, States
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Problem
from ..compiled.host import ENDS
from ..compiled.marching import STUCK

MOST_BODIES = 100  # a dense eigenvalue problem
SMALL = 1e-6  # change of a pose over the system's size, and of a rotation; of two central differences four digits hold
INDEPENDENT = 1e-9  # least singular value of an independent row, over the largest


def make_explainer(problem: Problem) -> Callable[[Any, int], str]:
    """Return the function ``explain`` (bundle, outcome) of a method whose iteration leaves out the slopes of forces."""
    return partial(_explain, problem)


def _explain(problem: Problem, bundle: Any, outcome: int) -> str:
    """Return the message for an ``outcome`` of a march; where springs or dampers stop its iteration, the step to take.

    That is found for at most ``MOST_BODIES`` bodies; for more the general message is returned.
    """
    if outcome == STUCK and problem.system.nb <= MOST_BODIES:
        rate = compute_fastest_rate(problem.system, problem.initial)
        if rate * float(bundle.control["h"]) > 1.0:
            return (
                "the iteration of a step does not converge with this step, as its matrix leaves out springs and "
                f"dampers: take dt below {1.0 / rate:.2g} s"
            )
    return ENDS[outcome][1]


def compute_fastest_rate(system: MultibodySystem, s: State) -> float:
    """Return the largest rate [1/s] at which applied forces let the mechanism vibrate, or damp it, joints closed.

    With N the motions that joints allow, normalised to unit masses, and K and C the slopes of forces by poses and by
    velocities, it is the larger of the root of the largest |eigenvalue| of N^T K N and the largest |eigenvalue| of N^T
    C N.
    """
    n = 6 * system.nb
    A = constraint_jacobian(system, s).toarray()
    to_unit = np.zeros((n, n))  # velocities of unit masses to those of bodies
    for b, (m, J) in enumerate(zip(system.mass, system.regular_inertia, strict=True)):
        at = slice(6 * b + 3, 6 * b + 6)
        to_unit[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = np.eye(3) / np.sqrt(m)
        moments, axes = np.linalg.eigh(J)
        to_unit[at, at] = axes / np.sqrt(moments)
    N = to_unit @ (sl.null_space(A @ to_unit, rcond=INDEPENDENT) if len(A) else np.eye(n))
    if not N.shape[1]:
        return 0.0
    K, C = (N.T @ slopes @ N for slopes in _force_slopes(system, s))
    return float(max(np.sqrt(np.max(np.abs(np.linalg.eigvals(K)))), np.max(np.abs(np.linalg.eigvals(C)))))


def _force_slopes(system: MultibodySystem, s: State) -> tuple[np.ndarray, np.ndarray]:
    """Return the slopes of applied loads by poses, and those by velocities, (6 nb, 6 nb) each, by central differences.

    Loads are (force [space], torque [body]), poses change by (dr, dtheta), R exp(hat(dtheta)).
    """
    nb, n = system.nb, 6 * system.nb
    size = max(float(np.max(system.gyration)), float(np.max(np.abs(s.r - s.r[0]))))
    step = np.tile(np.repeat((size or 1.0, 1.0), 3), nb) * SMALL
    change = np.concatenate((np.diag(step), np.diag(-step))).reshape(2 * n, nb, 6)
    still = np.zeros_like(change)
    out = []
    for by_pose, by_rate in ((change, still), (still, change)):
        moved = States(
            s.r + by_pose[..., :3], s.R @ so3.exp(by_pose[..., 3:]), s.v + by_rate[..., :3], s.Omega + by_rate[..., 3:]
        )
        load = applied_loads(system, moved.with_times(np.full(2 * n, s.t))).reshape(2, n, n)
        out.append(((load[0] - load[1]) / (2.0 * step[:, None])).T)
    return out[0], out[1]
