"""Step sizes chosen by the error: the PI controller of Gustafsson (1991), ACM Trans. Math. Softw. 17.

In the form of Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.2, p the order of the estimate::

    h_new = h 0.9 err^(-0.7/p) err_old^(0.4/p)   after a step with err <= 1,   h 0.9 err^(-1/p)   after a rejected one
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.types import Problem, Status, StepControl
from .march import Node

# as in ``formulations/compiled/host.py`` and ``marching.py``, whose comments say what half and twice do
FIRST_STEP = 1e-4  # [s]
SAFETY, LEAST, MOST, MOST_AGAIN = 0.9, 0.2, 5.0, 0.9  # bounds on the change of step size
SMALL = 1e-4  # least err_old
SHORTEST = 1e-14  # share of the time below which a step no longer advances it


class ErrorControl:
    """Control of the step size of a run from t = 0; a step whose iteration fails has no error and is halved."""

    def __init__(self, problem: Problem, control: StepControl, order: float) -> None:
        self.t_end, self.order, self.longest = problem.t_end, order, control.max_step or np.inf
        self.h, self.old_error = min(FIRST_STEP, problem.t_end), SMALL
        self.counters, self.ended = {"rejected": 0}, (Status.SUCCESS, "")

    def choose_step(self, t: float) -> float | None:
        """Return the step [s] to try at ``t``, at most ``max_step``; a rest of under two steps is halved.

        None at the end, or where a step would not advance the time: ``ended`` is then set to STEP_UNDERFLOW.
        """
        h, left = min(self.h, self.longest), self.t_end - t
        if left <= SHORTEST * t:
            return None
        if h < SHORTEST * max(t, 1e-6 * self.t_end):
            self.ended = Status.STEP_UNDERFLOW, "the error test asks for a step below the spacing of times"
            return None
        return left if h >= left * (1.0 - 1e-12) else min(h, 0.5 * left)  # two even steps, not one and a sliver

    def accept(self, h: float, result: Any) -> bool:
        """Return whether a step of ``h`` [s] is accepted, its error at most 1, and set the size of the next one.

        ``result`` is that of the step, with the error relative to its tolerance as fourth entry; None where it failed.
        """
        error = result[3] if result is not None else np.inf
        if error <= 1.0:
            change = SAFETY * max(error, 1e-10) ** (-0.7 / self.order) * self.old_error ** (0.4 / self.order)
            self.h, self.old_error = h * min(MOST, max(LEAST, change)), max(error, SMALL)
            return True
        self.h = h * (min(MOST_AGAIN, max(LEAST, SAFETY * error ** (-1.0 / self.order))) if result is not None else 0.5)
        self.counters["rejected"] += 1
        return False


def compute_tolerances(a: Node, b: Node, rtol: float) -> Float[np.ndarray, "nb 12"]:
    """Return the tolerances (nb, 12) of r [m], theta [rad] and v: rtol (1 + |y|), for theta ``rtol``.

    |y| is the larger of the values at the ends ``a`` and ``b`` of a step.
    """
    angles = np.zeros_like(a.r)
    return rtol * (1.0 + np.hstack((np.maximum(abs(a.r), abs(b.r)), angles, np.maximum(abs(a.v), abs(b.v)))))
