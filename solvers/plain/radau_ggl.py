"""Radau IIA of order 5 on stabilised index 2: Hairer and Wanner (1996), Solving Ordinary Diff. Equations II, IV.8.

Stabilised: Gear, Gupta and Leimkuhler (1985), J. Comput. Appl. Math. 12; Runge-Kutta on index 2: the text's VII.4. On
the rotation group as by Munthe-Kaas (1999), Appl. Numer. Math. 29: q = (r - r_0, theta), R = R_0 exp(theta). Stages
i = 1, 2, 3 of a step of h, the third being its end, with two multipliers, lam of v and eta of q::

    (1)  v_i = v_0 + h sum_j a_ij v'_j
    (2)  q_i = h sum_j a_ij q'_j,   q'_i = (r_dot_i + z_i, dexp^-1(theta_i) (Omega_i + z_i)),   z_i = M^-1 A_i^T eta_i
    (3)  M v'_i = f(q_i, v_i) + A_i^T lam_i
    (4)  phi(q_i) = 0,   A_i v_i + phi_t = 0

Newton's method is simplified: of its matrix only S_i = A_i M^-1 A_i^T at the present estimate remains, so that stages
need no complex systems; d_i = M^-1 (f_i + A_i^T lam_i) - v'_i is the residual of (3), w = a^-1, y = (q, v)::

    (5)  S_i dlam_i = -A_i d_i - sum_j w_ij (A v + phi_t)_j / h,   dv'_i = d_i + M^-1 A_i^T dlam_i
    (6)  S_i deta_i = (A v + phi_t)_i - sum_j w_ij phi_j / h
    (7)  |dy| Theta / (1 - Theta) <= tolerance,   Theta_k^2 = |dy_k| / |dy_(k-2)|     ends it

(7) is the text's stop test with the rate over two iterations, as in its program RADAU5: errors of q and of v alternate
before both fall.

The estimate of the error is (IV.8.19) without the factor (1 - h gamma f_y)^-1 that it has for stiff problems::

    (8)  e = gamma (h y'_0 + sum_i e_i (y_i - y_0))
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.mechanics import so3
from ...harness.mechanics.types import Problem, StepControl, Trajectory
from .error_control import ErrorControl, compute_tolerances
from .march import Node, begin, march
from .mechanics import Mechanism, move, solve

MOST_ITERATIONS, ORDER = 25, 4.0  # iterations at most; order of the error estimate, as the step sees it
S6 = np.sqrt(6.0)
A = np.array([
    [(88.0 - 7.0 * S6) / 360.0, (296.0 - 169.0 * S6) / 1800.0, (-2.0 + 3.0 * S6) / 225.0],
    [(296.0 + 169.0 * S6) / 1800.0, (88.0 + 7.0 * S6) / 360.0, (-2.0 - 3.0 * S6) / 225.0],
    [(16.0 - S6) / 36.0, (16.0 + S6) / 36.0, 1.0 / 9.0],
])  # fmt: skip
C, W = A.sum(axis=1), np.linalg.inv(A)
E = np.array([-13.0 - 7.0 * S6, -13.0 + 7.0 * S6, -1.0]) / 3.0
GAMMA = 1.0 / (3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0))  # the real eigenvalue of A


class CarriedState(NamedTuple):
    """v' and lam of the stages of the last step, and its size [s]; 0 before the first step."""

    v_dot: Float[np.ndarray, "3 n"]
    lam: Float[np.ndarray, "3 nr"]
    h: float


class Step:
    """The step for one problem; ``tolerance`` of (7) is relative to 1 + |y|, errors to what ``rtol`` allows."""

    def __init__(self, problem: Problem, tolerance: float, rtol: float) -> None:
        self.mechanism, self.tolerance, self.rtol = Mechanism(problem.system), tolerance, rtol
        self.counters = {"newton_iterations": 0}

    def start(self, problem: Problem) -> tuple[Node, CarriedState, np.ndarray]:
        """Return the first node, v' and lam of index 1 there as those of the last three stages, and lam as reaction."""
        node = begin(problem)
        v_dot, lam = self.mechanism.accelerate(*node)
        return node, CarriedState(np.tile(v_dot, (3, 1)), np.tile(lam, (3, 1)), 0.0), lam

    def __call__(self, h: float, x: Node, old: CarriedState) -> tuple[Node, CarriedState, np.ndarray, float] | None:
        """Step from ``x`` over ``h`` [s]; return the end node, the state to carry on, lam there, and the error (8).

        The error is over the tolerance of ``rtol``. Return None where the iteration does not converge.
        """
        m, v0 = self.mechanism, x.v.ravel()
        ahead = np.vander(1.0 + C * h / old.h if old.h > 0.0 else C, 3) @ np.linalg.inv(np.vander(C, 3))
        v_dot, lam = ahead @ old.v_dot, ahead @ old.lam  # on the parabolas through the last stages
        eta, z = np.zeros_like(lam), np.zeros_like(v_dot)
        q, v, sizes = np.outer(C * h, v0), v0 + h * A @ v_dot, list[float]()
        for _ in range(MOST_ITERATIONS):
            stages = [
                Node(x.t + c * h, *move(x.r, x.R, one.reshape(-1, 6)), u.reshape(-1, 6))
                for c, one, u in zip(C, q, v, strict=True)
            ]
            rows = [m.rows(*stage) for stage in stages]
            phi, phi_dot = np.stack([one.phi for one in rows]), np.stack([one.phi_dot for one in rows])  # (4)
            for i in range(3):
                S = m.schur(rows[i].A, rows[i].A)
                d = m.divide_by_inertia(m.forces(*stages[i]) + rows[i].A.T @ lam[i]) - v_dot[i]  # (3)
                dlam = solve(S, -rows[i].A @ d - W[i] @ phi_dot / h)  # (5)
                lam[i] += dlam
                v_dot[i] += d + m.divide_by_inertia(rows[i].A.T @ dlam)
                eta[i] += solve(S, phi_dot[i] - W[i] @ phi / h)  # (6)
                z[i] = m.divide_by_inertia(rows[i].A.T @ eta[i])
            q_before, v_before = q, v
            v = v0 + h * A @ v_dot  # (1)
            q = h * A @ find_stage_rates(q, v + z)  # (2)
            self.counters["newton_iterations"] += 1
            sizes.append(max(measure_change(q - q_before, q), measure_change(v - v_before, v)))
            if not np.isfinite(sizes[-1]):
                return None
            if estimate_further_changes(sizes) <= self.tolerance:  # (7)
                break
        else:
            return None
        b = Node(x.t + h, *move(x.r, x.R, q[2].reshape(-1, 6)), v[2].reshape(-1, 6))
        e = np.stack((h * v0 + E @ q, h * old.v_dot[2] + E @ (v - v0))).reshape(2, -1, 6)  # (8)
        error = GAMMA * np.sqrt(np.mean((np.hstack((e[0], e[1])) / compute_tolerances(x, b, self.rtol)) ** 2))
        return b, CarriedState(v_dot, lam, h), lam[2], float(error)


def estimate_further_changes(sizes: list[float]) -> float:
    """Return the expected sum of all further changes of an iteration, by (7) from the ``sizes`` of those so far.

    It is the last change itself where Theta >= 1, as at rounding; infinity before the third change; 0 after a zero.
    """
    if sizes[-1] == 0.0 or len(sizes) < 3:
        return 0.0 if sizes[-1] == 0.0 else np.inf
    theta = float(np.sqrt(sizes[-1] / sizes[-3]))
    return sizes[-1] * (theta / (1.0 - theta) if theta < 1.0 else 1.0)


def find_stage_rates(q: Float[np.ndarray, "3 n"], u: Float[np.ndarray, "3 n"]) -> Float[np.ndarray, "3 n"]:
    """Return q' of the three stages at ``q`` for velocities ``u`` = v + z of the bodies, (2)."""
    theta, out = q.reshape(3, -1, 6)[..., 3:], u.reshape(3, -1, 6).copy()
    out[..., 3:] = so3.dexpinv(theta, out[..., 3:])
    return out.reshape(q.shape)


def measure_change(change: Float[np.ndarray, "3 n"], reference: Float[np.ndarray, "3 n"]) -> float:
    """Return the largest entry of ``change`` relative to 1 + |y|, where y is ``reference``."""
    return float(np.max(np.abs(change) / (1.0 + np.abs(reference))))


def integrate(problem: Problem, control: StepControl, tolerance: float) -> Trajectory:
    """Integrate by Radau IIA with error control from the start to ``t_end``, and return the trajectory."""
    assert control.rtol is not None  # checked by the catalogue
    return march(problem, control, Step(problem, tolerance, control.rtol), ErrorControl(problem, control, ORDER))
