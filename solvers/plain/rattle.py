"""RATTLE on the rotation group, its drift the free rigid body: McLachlan, Modin, Verdier, Wilkins (2014).

SIAM J. Sci. Comput. 36. With p = M v, body momentum in rotation, a step of h from (q_0, v_0)::

    p_half = M v_0 + h/2 (f(q_0) + A_0^T x)
    q_1    = free motion over h from (q_0, p_half), with x such that phi(q_1) = 0
    v_1    = M^-1 (p_1 + h/2 (f(q_1) + A_1^T y)), with y such that A_1 v_1 = 0

A free body is exact where two principal inertias are equal, else split: with L = J Omega the part |L|^2 / 2 J_3 turns R
by exp(h L / J_3), the parts (1/J_i - 1/J_3) L_i^2 / 2 turn R by exp(z e_i) and L by its inverse. ``discrete``: the
discrete free body of Moser and Veselov (1991) instead, which makes the step that of Lee, Leok, McClamroch (2007).
"""

import numpy as np

from ...harness.mechanics import so3
from ...harness.mechanics.types import Problem, StepControl, Trajectory
from .march import Node, begin, march
from .mechanics import Mechanism, solve

# as in ``formulations/methods/iteration.py`` and ``rattle.py``, whose comments say what half and twice do
MOST_ITERATIONS, DAMPER_PASSES = 60, 6
EQUAL = 1e-14  # relative difference below which two principal inertias count as equal


class Step:
    """The step for one problem, phi below ``tolerance`` [m; axis rows without unit].

    ``discrete``: with the discrete free body.
    """

    def __init__(self, problem: Problem, tolerance: float, *, discrete: bool = False) -> None:
        """Set up the equations; unless the system is conservative, the end of a step takes several passes."""
        self.mechanism, self.tolerance, self.discrete = Mechanism(problem.system), tolerance, discrete
        # passes of the fixed point for f(q_1, v_1)
        self.passes = 1 if problem.system.is_conservative else DAMPER_PASSES
        self.counters = {"newton_iterations": 0}

    def start(self, problem: Problem) -> tuple[Node, None, np.ndarray]:
        """Return the first node, None as nothing is carried on, and the reaction of index 1."""
        node = begin(problem)
        return node, None, self.mechanism.accelerate(*node)[1]

    def __call__(self, h: float, a: Node, carried: None) -> tuple[Node, None, np.ndarray] | None:
        """Step from node ``a`` over ``h`` [s]; return the end node, None, and the reaction of index 1 there.

        Return None instead where phi does not converge to ``tolerance``.
        """
        m, t = self.mechanism, a.t + h
        rows, f = m.rows(*a), m.turn_to_bodies(a.R, m.loads(*a).ravel())
        S, x, last = m.schur(rows.A, rows.A), m.accelerate(*a)[1], np.inf
        for _ in range(MOST_ITERATIONS):
            p_half = m.multiply_by_inertia(a.v.ravel()) + 0.5 * h * (f + rows.A.T @ x)
            r, R, p = self.drift(h, a, p_half)
            v = m.divide_by_inertia(p).reshape(-1, 6)
            phi = m.rows(t, r, R, v).phi
            size = float(np.max(np.abs(phi), initial=0.0))
            if size <= self.tolerance and (size == 0.0 or size > 0.1 * last):
                break
            last = size
            x = x + solve(S, -2.0 * phi / h**2)
            self.counters["newton_iterations"] += 1
        else:
            return None
        for _ in range(self.passes):
            end = m.rows(t, r, R, v)
            pushed = m.divide_by_inertia(p + 0.5 * h * m.turn_to_bodies(R, m.loads(t, r, R, v).ravel()))
            left = end.A @ pushed + end.phi_dot - end.A @ v.ravel()  # A v + phi_t of the velocities pushed
            y = solve(m.schur(end.A, end.A), -left)
            v = (pushed + m.divide_by_inertia(end.A.T @ y)).reshape(-1, 6)
        node = Node(t, r, R, v)
        return node, None, m.accelerate(*node)[1]

    def drift(self, h: float, a: Node, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return r, R and p after free motion of all bodies over ``h`` [s] from the poses of ``a``, momenta ``p``."""
        m, six = self.mechanism, p.reshape(-1, 6).copy()
        R = a.R.copy()
        for b in range(m.nb):
            turn = turn_discretely if self.discrete else turn_freely
            R[b], six[b, 3:] = turn(m.J[b], h, R[b], six[b, 3:])
        return a.r + h * six[:, :3] / m.mass[:, None], R, six.ravel()


def turn_freely(J: np.ndarray, h: float, R: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return R and the angular momentum L [body frame] of a body of inertia ``J`` after free rotation for ``h`` [s].

    The rotation is exact for two equal principal inertias, else a symmetric splitting of second order.
    """
    diagonal = np.array_equal(J, np.diag(np.diag(J)))
    values, Q = (np.diag(J), np.eye(3)) if diagonal else np.linalg.eigh(J)
    first = int(np.argmin([abs(values[(k + 1) % 3] - values[(k + 2) % 3]) for k in range(3)]))
    order = [first, (first + 1) % 3, (first + 2) % 3]
    values, Q = values[order], Q[:, order] * (1.0, 1.0, np.linalg.det(Q))  # a rotation, not a reflection
    R, L = R @ Q, Q.T @ L
    rate = 1.0 / values - 1.0 / values[2]
    rate[np.abs(rate) * values[2] < EQUAL] = 0.0
    for axis, fraction in ((1, 0.5), (-1, 1.0), (0, 1.0), (1, 0.5)):
        if axis < 0:
            R = R @ so3.exp(h * L / values[2])
        else:
            turn = so3.exp(fraction * h * rate[axis] * L[axis] * np.eye(3)[axis])
            R, L = R @ turn, turn.T @ L
    return R @ Q.T, Q @ L


def turn_discretely(J: np.ndarray, h: float, R: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return R F and F^T L, orientation and angular momentum [body frame] after free rotation for ``h`` [s].

    F solves the discrete equations of Moser and Veselov, hat(h L) = F J_d - J_d F^T with J_d = tr(J)/2 - J, as Cayley's
    map of a vector f, by Newton's method.
    """
    g = h * L

    def find_residual(f: np.ndarray) -> np.ndarray:
        """Return the residual of the equations in terms of the vector ``f``."""
        return g + np.cross(g, f) + (g @ f) * f - 2.0 * J @ f

    f = np.zeros(3)
    for _ in range(MOST_ITERATIONS):
        slope = so3.hat(g) + np.outer(f, g) + (g @ f) * np.eye(3) - 2.0 * J
        change = np.linalg.solve(slope, -find_residual(f))
        f = f + change
        if np.max(np.abs(change)) < 1e-15:
            break
    F = np.eye(3) + 2.0 / (1.0 + f @ f) * (so3.hat(f) + so3.hat(f) @ so3.hat(f))
    return R @ F, F.T @ L


def integrate(problem: Problem, control: StepControl, tolerance: float, *, discrete: bool = False) -> Trajectory:
    """Integrate by RATTLE from the start to ``t_end``, and return the trajectory; ``discrete``: as in ``Step``."""
    return march(problem, control, Step(problem, tolerance, discrete=discrete))
