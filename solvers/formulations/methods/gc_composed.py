"""Symmetric compositions of ODE-GC's step in the symmetric gauge; mu starts anew in each sub-step (compiled)."""

from typing import Any

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ..compiled.bundles import make_bundle
from ..compiled.entries import run
from ..compiled.host import ENDS, Method
from ..compiled.kernel import Kernel
from ..compiled.marching import STUCK
from .choices import Settings
from .gc_step import NEEDED, accept_step, begin_march, begin_step, find_end, make_step, refresh_factor

# h |Omega| sqrt(J2/J1) of a slender body that converges: tried on J2/J1 = 1e3 to 1e6 and all compositions, 0.7 and less
# converge, 1 and more do not; at half, steps shorter than needed are named, at twice, steps that end as well
CONVERGES = 0.5


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
        explain=explain,
        needs=() if choices.whole else NEEDED,
        code="mechanism" if choices.whole else "kernel",
    )


def start(m):
    """Compute acceleration and multipliers of index 1 at the start, from which the first step is estimated."""
    begin_march(m.step)


def step(m):
    """Take all sub-steps of a step of ``control.h``; set ``control.status`` to STUCK where one does not converge."""
    s = m.step
    t = s.control.t
    for i in range(len(m.gamma)):
        h = m.gamma[i] * s.control.h
        begin_step(s, h)
        if find_end(s, h, t + 0.5 * h) < 0.0:
            s.control.status = STUCK
            break
        accept_step(s, h, t + 0.5 * h)
        t += h


def finish(m):
    """Compute accelerations and the recorded reactions, those of index 1, and the factor for the next step."""
    run(m.step.kernel.accelerate)
    refresh_factor(m.step)


def explain(m: Any, outcome: int) -> str:
    """Return the message for an ``outcome`` of the march; where a slender body stops its iteration, the step to take.

    The iteration leaves out the gyroscopic torque Omega x J Omega. Two sweeps of a body with principal moments J1 << J2
    multiply the error by about (h |Omega|)^2 J2/J1; steps with h |Omega| sqrt(J2/J1) up to ``CONVERGES`` converge.
    """
    longest = float(np.max(np.abs(m.gamma)))
    moments = np.linalg.eigvalsh(m.step.kernel.J)
    ratio = moments[:, -1] / np.maximum(moments[:, 0], np.finfo(float).tiny)
    rate = longest * float(np.max(np.linalg.norm(m.step.v0[:, 3:], axis=1) * np.sqrt(ratio)))
    if outcome == STUCK and np.isfinite(rate) and rate * float(m.step.control["h"]) > CONVERGES:
        return (
            "the iteration of a step does not converge with this step, as it leaves out the gyroscopic torque of "
            f"slender bodies: take gc_weak_form, or dt below {CONVERGES / rate:.2g} s"
        )
    return ENDS[outcome][1]
