"""Half-explicit Runge-Kutta steps of order 4 on index 2: Brasey and Hairer (1993), SIAM J. Numer. Anal. 30 (HEM4).

With R = R_0 exp(theta) in a step (Munthe-Kaas 1999), stages i = 1 to 5, the sixth being the end of the step::

    Q_i = q_0 + h sum_{j<i} a_ij q'_j,   V_i = v_0 + h sum_{j<i} a_ij V'_j,   q' = (r_dot, dexp^-1(theta) Omega)
    M V'_i = f(Q_i, V_i) + A(Q_i)^T lam_i,   lam_i such that A(Q_{i+1}) V_{i+1} + phi_t = 0

The end is projected: poses onto phi = 0, then velocities onto A v + phi_t = 0, both along M^-1 A^T.
"""

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.types import Problem, StepControl, Trajectory
from .march import Node, begin, march
from .mechanics import Mechanism, move, solve

STAGES, W = 5, np.sqrt(6.0)
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [0.3, 0.0, 0.0, 0.0, 0.0],
    [(1.0 + W) / 30.0, (11.0 - 4.0 * W) / 30.0, 0.0, 0.0, 0.0],
    [(-79.0 - 31.0 * W) / 150.0, (-1.0 - 4.0 * W) / 30.0, (24.0 + 11.0 * W) / 25.0, 0.0, 0.0],
    [(14.0 + 5.0 * W) / 6.0, (-8.0 + 7.0 * W) / 6.0, (-9.0 - 7.0 * W) / 4.0, (9.0 - W) / 4.0, 0.0],
    [0.0, 0.0, (16.0 - W) / 36.0, (16.0 + W) / 36.0, 1.0 / 9.0],
])  # fmt: skip
C = A.sum(axis=1)


class Step:
    """The step for one problem."""

    def __init__(self, problem: Problem) -> None:
        self.mechanism, self.counters = Mechanism(problem.system), dict[str, int]()

    def start(self, problem: Problem) -> tuple[Node, None, np.ndarray]:
        """Return the first node, None as nothing is carried on, and the reaction of index 1."""
        node = begin(problem)
        return node, None, self.mechanism.accelerate(*node)[1]

    def __call__(self, h: float, x: Node, carried: None) -> tuple[Node, None, np.ndarray] | None:
        """Step from node ``x`` over ``h`` [s]; return the projected end node, None, and lam of index 1 before that.

        Return None instead where a body rotates by half a turn or more.
        """
        m, moves, gains = self.mechanism, list[np.ndarray](), list[np.ndarray]()
        theta, stage, rows = np.zeros((m.nb, 3)), x, m.rows(*x)
        for i in range(STAGES):
            moves.append(np.hstack((stage.v[:, :3], _theta_dot(theta, stage.v[:, 3:]))))
            free = m.divide_by_inertia(m.forces(*stage))
            q = h * sum(A[i + 1, j] * moves[j] for j in range(i + 1))
            theta = q[:, 3:]
            if not np.all(np.linalg.norm(theta, axis=1) < np.pi):
                return None
            t, (r, R) = x.t + h * C[i + 1], move(x.r, x.R, q)
            V = x.v.ravel() + h * (sum(A[i + 1, j] * gains[j] for j in range(i)) + A[i + 1, i] * free)
            after = m.rows(t, r, R, V.reshape(-1, 6))
            lam = solve(m.schur(after.A, rows.A), -after.phi_dot / (h * A[i + 1, i]))
            gains.append(free + m.divide_by_inertia(rows.A.T @ lam))
            v = (x.v.ravel() + h * sum(A[i + 1, j] * gains[j] for j in range(i + 1))).reshape(-1, 6)
            stage, rows = Node(t, r, R, v), after
        end, lam = m.rows(*stage), m.accelerate(*stage)[1]
        S = m.schur(end.A, end.A)
        r, R = move(stage.r, stage.R, m.divide_by_inertia(end.A.T @ solve(S, -end.phi)).reshape(-1, 6))
        end = m.rows(stage.t, r, R, stage.v)
        v = stage.v + m.divide_by_inertia(end.A.T @ solve(S, -end.phi_dot)).reshape(-1, 6)
        return Node(stage.t, r, R, v), None, lam


def _theta_dot(theta: Float[np.ndarray, "nb 3"], Omega: Float[np.ndarray, "nb 3"]) -> Float[np.ndarray, "nb 3"]:
    """Return dexp^-1(theta) Omega, the rate of theta where R_0 exp(theta) rotates at Omega [rad/s, body].

    Below 1e-4 rad its factor is a series.
    """
    size = np.linalg.norm(theta, axis=1)[:, None]
    half = 0.5 * np.where(size < 1e-4, 1.0, size)
    factor = np.where(size < 1e-4, 1.0 / 12.0 + size**2 / 720.0, (1.0 - half / np.tan(half)) / (2.0 * half) ** 2)
    across = np.cross(theta, Omega)
    return Omega + 0.5 * across + factor * np.cross(theta, across)


def integrate(problem: Problem, control: StepControl) -> Trajectory:
    """Integrate by half-explicit steps from the start to ``t_end``, and return the trajectory."""
    return march(problem, control, Step(problem))
