"""Symmetric compositions of ODE-GC's step in the symmetric gauge; mu starts anew in each sub-step (compiled)."""

from typing import Any

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ..compiled.bundles import make_bundle
from ..compiled.entries import run
from ..compiled.host import Method
from ..compiled.kernel import Kernel
from ..compiled.marching import STUCK
from .choices import Settings
from .gc_step import NEEDED, accept_step, begin_march, begin_step, make_step, refresh_factor, take_step


def make_composed_method(system: MultibodySystem, choices: Settings, gamma: np.ndarray, rate: float) -> Method:
    """Make the method of a symmetric composition of ODE-GC's step, for ``host.integrate``.

    Its sub-steps are ``gamma`` times dt; ``rate`` [rad/s] is that of reversible step control, 0 for fixed steps.
    """

    def prepare(kernel: Kernel, control: np.ndarray) -> Any:
        """Make the bundle of a step for this kernel and control."""
        return make_bundle("Composed", {}, {}, step=make_step(system, kernel, control, choices), gamma=gamma)

    counters = "iterations", "factorisations"
    return Method(
        prepare,
        step,
        finish,
        start,
        rate=rate,
        counters=counters,
        needs=() if choices.whole else NEEDED,
        code="mechanism" if choices.whole else "kernel",
    )


def start(m):
    """Compute acceleration and multipliers of index 1 at the start, from which the first step is estimated."""
    begin_march(m.step)


def step(m):
    """Take all sub-steps of ``control.h``; set ``control.status`` to STUCK where one does not converge."""
    s = m.step
    t = s.control.t
    for i in range(len(m.gamma)):
        h = m.gamma[i] * s.control.h
        begin_step(s, h)
        if take_step(s, h, t + 0.5 * h) < 0.0:
            s.control.status = STUCK
            break
        accept_step(s, h, t + 0.5 * h)
        t += h


def finish(m):
    """Compute the reactions recorded, those of index 1, and the factor for the next step."""
    run(m.step.kernel.accelerate)
    refresh_factor(m.step)
