"""Runge-Kutta steps on the rotation group, on index 1 and projected: Munthe-Kaas (1999), Appl. Numer. Math. 29.

Pairs are those of Dormand and Prince (1980), J. Comput. Appl. Math. 6, and Hairer, Norsett and Wanner (1993), Solving
Ordinary Differential Equations I, II.10 (DOP853). In a step of h, q = (r - r_0, theta) and R = R_0 exp(theta). Stages
are i = 1 to s, and s + 1, which has the weights b and is the end of the step::

    (1)  q_i = h sum_{j<i} a_ij q'_j,   v_i = v_0 + h sum_{j<i} a_ij v'_j
    (2)  q'_i = (r_dot_i, dexp^-1(theta_i) Omega_i)
    (3)  M v'_i = f(q_i, v_i) + A_i^T lam_i,   A_i v'_i = -gamma_i            index 1: phi_ddot = 0
    (4)  e = h sum_{i<=s+1} e_i (q'_i, v'_i)                                  the pair's estimate of the error
    (5)  r, R += M^-1 A^T x,  S x = -phi;   v += M^-1 A^T y,  S y = -(A v + phi_t);   S = A M^-1 A^T

The accelerations (3) at the end serve as the first ones of the next step, although (5) moves that point by as much as
(4) allows.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import DOP853, RK45

from ...harness.mechanics import so3
from ...harness.mechanics.types import Problem, StepControl, Trajectory
from .error_control import ErrorControl, compute_tolerances
from .march import Node, begin, march
from .mechanics import Mechanism, move, solve


class Pair(NamedTuple):
    """An embedded pair: nodes c, weights a with b as the last row, and weights e of one error estimate or two."""

    c: Float[np.ndarray, " s1"]
    a: Float[np.ndarray, "s1 s"]
    e: Float[np.ndarray, "ne s1"]
    order: float


PAIRS = {
    "5(4)": Pair(np.append(RK45.C, 1.0), np.vstack((np.pad(RK45.A, ((0, 0), (0, 1))), RK45.B)), RK45.E[None], 5.0),
    "8(5,3)": Pair(np.append(DOP853.C, 1.0), np.vstack((DOP853.A, DOP853.B)), np.stack((DOP853.E5, DOP853.E3)), 8.0),
}


class Step:
    """The step for one problem by a pair; errors are relative to what ``rtol`` allows."""

    def __init__(self, problem: Problem, pair: Pair, rtol: float) -> None:
        self.mechanism, self.pair, self.rtol = Mechanism(problem.system), pair, rtol
        self.counters = {"evaluations": 0}

    def start(self, problem: Problem) -> tuple[Node, np.ndarray, np.ndarray]:
        """Return the first node, its slope (q', v') to carry on, and the reaction there."""
        node = begin(problem)
        slope, lam = self.evaluate_slope(node, np.zeros((self.mechanism.nb, 3)))
        return node, slope, lam

    def evaluate_slope(
        self, x: Node, theta: Float[np.ndarray, "nb 3"]
    ) -> tuple[Float[np.ndarray, "nb 12"], np.ndarray]:
        """Return the slope (q', v') and the multipliers lam at a stage ``x`` with rotation vectors ``theta``."""
        v_dot, lam = self.mechanism.accelerate(*x)  # (3)
        self.counters["evaluations"] += 1
        return np.hstack((x.v[:, :3], so3.dexpinv(theta, x.v[:, 3:]), v_dot.reshape(-1, 6))), lam  # (2)

    def __call__(self, h: float, x: Node, first: np.ndarray) -> tuple[Node, np.ndarray, np.ndarray, float]:
        """Step from ``x``, whose slope is ``first``, over ``h`` [s]; return end node, slope to carry on, lam, error.

        lam is that before the projection (5); the error (4) is relative to its tolerance.
        """
        m, slopes, end, lam = self.mechanism, [first], x, np.zeros(0)
        for c, a in zip(self.pair.c[1:], self.pair.a[1:], strict=True):
            change = h * sum(weight * slope for weight, slope in zip(a, slopes, strict=False))  # (1)
            end = Node(x.t + c * h, *move(x.r, x.R, change[:, :6]), x.v + change[:, 6:])
            slope, lam = self.evaluate_slope(end, change[:, 3:6])
            slopes.append(slope)
        error = self.measure_error([h * np.tensordot(e, slopes, 1) for e in self.pair.e], x, end)  # (4)
        rows = m.rows(*end)
        S = m.schur(rows.A, rows.A)
        r, R = move(end.r, end.R, m.divide_by_inertia(rows.A.T @ solve(S, -rows.phi)).reshape(-1, 6))  # (5)
        rows = m.rows(end.t, r, R, end.v)
        v = end.v + m.divide_by_inertia(rows.A.T @ solve(S, -rows.phi_dot)).reshape(-1, 6)
        return Node(end.t, r, R, v), np.hstack((v, slopes[-1][:, 6:])), lam, error

    def measure_error(self, errors: list[np.ndarray], x: Node, end: Node) -> float:
        """Return the error of a step relative to its tolerance: the root mean square of one estimate.

        For two estimates e5, e3 it is |e5|^2 / sqrt(|e5|^2 + 0.01 |e3|^2), with norms by the root mean square.
        """
        squares = [float(np.mean((e / compute_tolerances(x, end, self.rtol)) ** 2)) for e in errors]
        if len(squares) == 1 or squares == [0.0, 0.0]:
            return float(np.sqrt(squares[0]))
        return squares[0] / float(np.sqrt(squares[0] + 0.01 * squares[1]))


def integrate(problem: Problem, control: StepControl, pair: str) -> Trajectory:
    """Integrate by the ``pair`` of ``PAIRS`` with error control from the start to ``t_end``; return the trajectory."""
    assert control.rtol is not None  # checked by the catalogue
    chosen = PAIRS[pair]
    return march(problem, control, Step(problem, chosen, control.rtol), ErrorControl(problem, control, chosen.order))
