"""Symmetric compositions of ODE-GC's step in the symmetric gauge, whose mu starts anew in each sub-step (compiled).

A module for ``index1.integrate.fixed_steps``: ``empty_step``, ``start`` and ``march``.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..choices import Settings
from ..index1.fixed_step import STUCK, keep_step, paced
from ..index1.kernel import Kernel, accelerate
from ..index1.rkmk import FINISHED, FULL, NOT_FINITE
from ..newton import COUNTERS, FACTORISATIONS, NEWTON
from ..vectors import JIT
from .march import accept
from .march import start as begin
from .rows import arms
from .state import Lean, empty_lean
from .step import one_step, poses


class Scheme(NamedTuple):
    """The step's choices, and its sub-steps ``gamma dt``."""

    settings: Settings
    gamma: np.ndarray
    rate: float  # [rad/s] of reversible step control; 0: steps of dt


class Step(NamedTuple):
    """Room for one step."""

    lean: Lean
    clock: np.ndarray  # (3,) of ``index1.fixed_step``
    pace: np.ndarray  # (3,) of the same
    counts: np.ndarray


def empty_step(model: Model) -> Step:
    """Arrays of one sub-step."""
    return Step(empty_lean(model), np.zeros(3, dtype=np.int64), np.zeros(3), np.zeros(len(COUNTERS), dtype=np.int64))


def start(k: Kernel, step: Step) -> None:
    """Acceleration and multipliers of index 1 stand for a step before the first."""
    mine = step.lean.k
    mine.r[:], mine.R[:], mine.v[:] = k.r, k.R, k.v
    begin(step.lean)


@njit(**JIT)
def march(model, blocks, k, step, s, dt, t_end, record):
    """Steps of ``dt``, each the sub-steps ``gamma dt``; returns (outcome, steps recorded)."""
    lean, settings, done = step.lean, s.settings, 0
    arms(lean, settings)
    while done < len(record.t):
        t0, t1 = paced(step.pace, lean.k, s.rate, step.clock, dt, t_end)
        if not t1 > t0:
            return FINISHED, done
        t = t0
        for i in range(len(s.gamma)):
            h = s.gamma[i] * (t1 - t0)
            if one_step(lean, settings, h, t + 0.5 * h, step.counts) < 0.0:
                return STUCK, done
            poses(lean, h)
            accept(lean, settings, h, t + 0.5 * h)
            t += h
        accelerate(model, lean.blocks, lean.k)  # reactions, and the factor for the next step
        step.clock[1], step.clock[2] = step.counts[NEWTON], step.counts[FACTORISATIONS]
        if not keep_step(lean.k, lean.k.lam, step.clock, t1, record, done):
            return NOT_FINITE, done
        done += 1
    return FULL, done
