"""ODE-GC with fixed steps by the simplified method (compiled); reactions are means over the steps."""

from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import clear, turned_by
from ..compiled.entries import inner, run
from ..compiled.kernel import Kernel
from ..compiled.marching import STUCK
from .gc_step import DEPTH, Step, accept_step, begin_march, begin_step, make_step, move_poses, take_step

SLIVER = 1e-9  # of dt


class Plain(NamedTuple):
    """A step, and what follows it."""

    step: Step
    passes: int  # of the correction of poses to phi = 0; 0: none


def prepare(kernel: Kernel, control: np.ndarray, *, system: MultibodySystem, choices: dict, passes: int = 0) -> Any:
    """The bundle of a step, and what keeps its entries alive."""
    made = make_step(system, kernel, control, **choices)
    return Plain(made.step, passes), made.keeps


def start(m):
    """Acceleration and multipliers of index 1."""
    begin_march(m.step)


def step(m):
    """One step of ``control.h``; what does not converge leaves the start in ``r0``, ``R0``, ``v0``."""
    s, c = m.step, m.step.control
    h = _length(c)
    if take_step(s, h, c.t + 0.5 * h) < 0.0:
        c.status = STUCK


@inner
def _length(c):
    """``h``, or ``dt`` where rounding of times is all between them: the next step may begin with what this one ends."""
    return c.dt if abs(c.h - c.dt) < SLIVER * c.dt else c.h


def finish(m):
    """Poses of the end, corrected and closed; the step becomes the past, and ``lam`` its mean reaction."""
    s, c, k = m.step, m.step.control, m.step.kernel
    h = _length(c)
    move_poses(s, h)
    for _ in range(m.passes):
        _correct_poses(k)
    for b in range(len(k.mass)):
        _close_rotation(k.R[b])
    accept_step(s, h, c.t + 0.5 * h)
    d = (s.scheme.known - 1) % DEPTH
    for a in range(len(k.lam)):
        k.lam[a] = s.impulse[d, a] - 0.5 * s.f_bar0[a]
    begin_step(s, h)
    s.scheme.begun = 1
    for a in range(len(k.lam)):
        k.lam[a] -= 0.5 * s.f_bar0[a]


@inner
def _correct_poses(k):
    """Least change of the poses, in the norm of M, that takes phi to zero: one pass with the factor at hand."""
    run(k.rows)
    for a in range(len(k.rhs)):
        k.rhs[a] = -k.phi[a]
    run(k.solve)
    for a in range(len(k.rhs)):
        k.x[a] = k.rhs[a]
    clear(k.w)
    run(k.push)
    for b in range(len(k.mass)):
        for a in range(3):
            k.r[b, a] += k.w[b, a]
        turned_by(k.R[b], k.w[b, 3], k.w[b, 4], k.w[b, 5], k.R[b])


@inner
def _close_rotation(Q):
    """Q := Q (3 - Q^T Q) / 2: leaves of a distance e from the rotations 3/4 e^2, that is rounding."""
    d0 = d1 = d2 = 1.5
    p = q = r = 0.0
    for a in range(3):
        x, y, z = Q[a, 0], Q[a, 1], Q[a, 2]
        d0, d1, d2 = d0 - 0.5 * x * x, d1 - 0.5 * y * y, d2 - 0.5 * z * z
        p, q, r = p - 0.5 * y * z, q - 0.5 * z * x, r - 0.5 * x * y
    for a in range(3):
        x, y, z = Q[a, 0], Q[a, 1], Q[a, 2]
        Q[a, 0], Q[a, 1], Q[a, 2] = d0 * x + r * y + q * z, r * x + d1 * y + p * z, q * x + p * y + d2 * z
