"""Generalised alpha on the rotation group: Bruls, Cardona, Arnold (2012), Mech. Mach. Theory 48.

Stabilised index 2: Arnold, Bruls, Cardona (2015), Numer. Math. 129; projected, with the trapezoidal rule: the augmented
Lagrangian of index 3, Bayo and Ledesma (1996), Nonlinear Dyn. 9. From (q_0, v_0, vdot_0, a_0)::

    (1 - alpha_m) a_1 + alpha_m a_0 = (1 - alpha_f) vdot_1 + alpha_f vdot_0
    v_1 = v_0 + (1 - gamma) h a_0 + gamma h a_1
    dq  = h v_0 + (1/2 - beta) h^2 a_0 + beta h^2 a_1 [+ M^-1 A^T eta],   q_1 = q_0 o exp(dq)
    M vdot_1 = f(q_1, v_1) + A_1^T lam,   phi(q_1) = 0   [and A_1 v_1 + phi_t = 0 with eta]
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.types import Problem, StepControl, Trajectory
from .march import Node, begin, march
from .mechanics import Mechanism, move, solve

MOST_ITERATIONS = 60  # as in ``formulations/methods/iteration.py``, whose comment says what half and twice do


class CarriedState(NamedTuple):
    """Accelerations of the motion and of the scheme at the end of a step, and the multipliers there."""

    vdot: Float[np.ndarray, " n"]
    a: Float[np.ndarray, " n"]
    lam: Float[np.ndarray, " nr"]


@dataclass
class Step:
    """The step for one problem; ``tolerance`` bounds phi and the last correction of poses [m; angles in rad]."""

    problem: Problem
    tolerance: float
    beta: float
    gamma: float
    alpha_m: float = 0.0
    alpha_f: float = 0.0
    stabilised: bool = False
    projected: bool = False

    def __post_init__(self) -> None:
        self.mechanism, self.counters = Mechanism(self.problem.system), {"newton_iterations": 0}

    def start(self, problem: Problem) -> tuple[Node, CarriedState, np.ndarray]:
        """Return the first node, the accelerations of index 1 to carry on, and the reaction there."""
        node = begin(problem)
        vdot, lam = self.mechanism.accelerate(*node)
        return node, CarriedState(vdot, vdot, np.zeros_like(lam)), lam

    def __call__(self, h: float, x: Node, old: CarriedState) -> tuple[Node, CarriedState, np.ndarray] | None:
        """Step from node ``x`` over ``h`` [s]; return the end node, the state to carry on, and lam there.

        Newton's method takes S = A M^-1 A^T at the present estimate. Return None where it does not converge.
        """
        m, t, last = self.mechanism, x.t + h, np.inf
        share = (1.0 - self.alpha_f) / (1.0 - self.alpha_m)
        on_q, on_v = share * self.beta * h * h, share * self.gamma * h
        vdot, lam, slack = old.vdot, old.lam, np.zeros_like(old.vdot)
        for _ in range(MOST_ITERATIONS):
            a, v, r, R = self.predict(h, x, old, vdot, slack)
            rows, f = m.rows(t, r, R, v), m.forces(t, r, R, v)
            S = m.schur(rows.A, rows.A)
            d = m.divide_by_inertia(f + rows.A.T @ lam) - vdot
            size = float(np.max(np.abs(rows.phi), initial=0.0))
            if self.stabilised:
                size = max(size, on_q / on_v * float(np.max(np.abs(rows.phi_dot), initial=0.0)))
                dlam = solve(S, -rows.A @ d - rows.phi_dot / on_v)
                slack = slack + m.divide_by_inertia(rows.A.T @ solve(S, on_q / on_v * rows.phi_dot - rows.phi))
            else:
                dlam = solve(S, -rows.A @ d - rows.phi / on_q)
            change = d + m.divide_by_inertia(rows.A.T @ dlam)
            lam, vdot = lam + dlam, vdot + change
            self.counters["newton_iterations"] += 1
            size = max(size, on_q * float(np.max(np.abs(change))))
            if not np.isfinite(size):
                return None
            if size <= self.tolerance and (size == 0.0 or size > 0.1 * last):
                break
            last = size
        else:
            return None
        a, v, r, R = self.predict(h, x, old, vdot, slack)
        if self.projected:  # v onto A v + phi_t = 0, then vdot onto A vdot = -gamma, along M^-1 A^T
            rows = m.rows(t, r, R, v)
            S = m.schur(rows.A, rows.A)
            v = v + m.divide_by_inertia(rows.A.T @ solve(S, -rows.phi_dot)).reshape(-1, 6)
            more = solve(S, -m.rows(t, r, R, v).gamma - rows.A @ vdot)
            lam, vdot = lam + more, vdot + m.divide_by_inertia(rows.A.T @ more)
            a = vdot
        node = Node(t, r, R, v)
        return node, CarriedState(vdot, a, lam), lam

    def predict(
        self, h: float, x: Node, old: CarriedState, vdot: np.ndarray, slack: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Return a_1, v_1, r_1 and R_1 of the scheme for the acceleration ``vdot`` at the end of the step.

        ``slack`` is M^-1 A^T eta.
        """
        a = ((1.0 - self.alpha_f) * vdot + self.alpha_f * old.vdot - self.alpha_m * old.a) / (1.0 - self.alpha_m)
        v0 = x.v.ravel()
        v = v0 + h * ((1.0 - self.gamma) * old.a + self.gamma * a)
        dq = h * v0 + h * h * ((0.5 - self.beta) * old.a + self.beta * a) + slack
        return a, v.reshape(-1, 6), *move(x.r, x.R, dq.reshape(-1, 6))


def integrate(problem: Problem, control: StepControl, tolerance: float, **scheme: Any) -> Trajectory:
    """Integrate by generalised alpha from the start to ``t_end``, and return the trajectory.

    ``scheme`` are parameters of ``Step``, such as ``beta`` and ``gamma``.
    """
    return march(problem, control, Step(problem, tolerance, **scheme))
