"""Mean-value steps that conserve energy and momentum: Simo and Wong (1991), Int. J. Numer. Meth. Eng. 31.

Discrete gradients: Gonzalez (1996), J. Nonlinear Sci. 6. With v_m = (v_0 + v_1) / 2, R_m = (R_0 + R_1) / 2 (no
rotation), Cayley's map and Omega_m the rotational part of v_m::

    r_1 = r_0 + h r_dot_m,   R_1 = R_0 cay(h Omega_m)
    m (r_dot_1 - r_dot_0) = h sum F,   J (Omega_1 - Omega_0) + h Omega_m x J Omega_m = h R_m^-1 sum T,   phi(q_1) = 0

A row whose phi is quadratic in r and R has its gradient at the mean pose, A_m v_m = (phi_1 - phi_0) / h. A spring pulls
along the mean line with k (1 - 2 d_free / (d_0 + d_1)), a damper with (2 c / h) (d_1 - d_0) / (d_0 + d_1).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.mechanics import so3
from ...harness.mechanics.system import GROUND
from ...harness.mechanics.types import Problem, StepControl, Trajectory
from .march import Node, begin, march
from .mechanics import Mechanism, solve

MOST_ITERATIONS = 60  # as in ``formulations/methods/iteration.py``, whose comment says what half and twice do


class CarriedState(NamedTuple):
    """The change of v over the last step, the first estimate of the next one, and multipliers of two midpoints."""

    change: Float[np.ndarray, "nb 6"]
    F: Float[np.ndarray, " nr"]  # of the last step's midpoint
    F_before: Float[np.ndarray, " nr"]  # of the midpoint before


class Step:
    """The step for one problem; ``tolerance`` bounds phi and the last correction of poses [m; angles in rad]."""

    def __init__(self, problem: Problem, tolerance: float) -> None:
        self.mechanism, self.tolerance = Mechanism(problem.system), tolerance
        self.counters = {"newton_iterations": 0}

    def start(self, problem: Problem) -> tuple[Node, CarriedState, np.ndarray]:
        """Return the first node, the state carried to the first step, and the reaction of index 1.

        This reaction also replaces the multipliers of the midpoints before the start.
        """
        node = begin(problem)
        lam = self.mechanism.accelerate(*node)[1]
        return node, CarriedState(np.zeros_like(node.v), lam, lam), lam

    def __call__(self, h: float, a: Node, old: CarriedState) -> tuple[Node, CarriedState, np.ndarray] | None:
        """Step from node ``a`` over ``h`` [s]; return the end node, the state to carry on, and the reaction there.

        Newton's method takes S of the mean rows at the present estimate. Return None where it does not converge.
        """
        m, v1, F, last = self.mechanism, a.v + old.change, old.F, np.inf
        for _ in range(MOST_ITERATIONS):
            v_m = 0.5 * (a.v + v1)
            r, R = a.r + h * v_m[:, :3], a.R @ _cayley(0.5 * h * v_m[:, 3:])
            mean = m.rows(a.t + 0.5 * h, 0.5 * (a.r + r), 0.5 * (a.R + R), v_m)
            A = np.array([self.turn_to_bodies(h, a, v_m, row) for row in mean.D.T]).reshape(m.nr, 6 * m.nb)
            phi = m.rows(a.t + h, r, R, v1).phi
            f = self.turn_to_bodies(h, a, v_m, self.average_loads(h, a, Node(a.t + h, r, R, v1)))
            spin = np.cross(v_m[:, 3:], np.einsum("bij,bj->bi", m.J, v_m[:, 3:]))
            f = f - np.hstack((np.zeros((m.nb, 3)), spin)).ravel()
            off = (a.v - v1).ravel() + h * m.divide_by_inertia(f + A.T @ F)
            P = solve(m.schur(A, A), -A @ off - 2.0 * phi / h)
            change = off + m.divide_by_inertia(A.T @ P)
            F, v1 = F + P / h, v1 + change.reshape(-1, 6)
            self.counters["newton_iterations"] += 1
            size = max(float(np.max(np.abs(phi), initial=0.0)), h * float(np.max(np.abs(change))))
            if not np.isfinite(size):
                return None
            if size <= self.tolerance and (size == 0.0 or size > 0.1 * last):
                break
            last = size
        else:
            return None
        v_m = 0.5 * (a.v + v1)
        node = Node(a.t + h, a.r + h * v_m[:, :3], a.R @ _cayley(0.5 * h * v_m[:, 3:]), v1)
        # multipliers of the middle alternate by O(h), as A v of the ends may: that cancels in F + (F' - F'') / 2
        return node, CarriedState(v1 - a.v, F, old.F), F + 0.5 * (old.F - old.F_before)

    def average_loads(self, h: float, a: Node, b: Node) -> Float[np.ndarray, " n"]:
        """Return the mean applied wrenches (n,), in space about C, over a step of ``h`` [s] from ``a`` to ``b``.

        They are gravity, springs and dampers by discrete gradients, and loads as means of both ends.
        """
        m, s, out = self.mechanism, self.mechanism.system, np.zeros((self.mechanism.nb, 6))
        out[:, :3] = m.mass[:, None] * s.gravity
        for k, ends in enumerate(zip(s.spring_i, s.spring_j, strict=True)):
            points = [
                [x.R[e] @ p + x.r[e] if e != GROUND else p for x in (a, b)]
                for e, p in zip(ends, (s.spring_p_i[k], s.spring_p_j[k]), strict=True)
            ]
            lines = [points[0][n] - points[1][n] for n in range(2)]
            d0, d1 = (float(np.linalg.norm(line)) for line in lines)
            pull = s.spring_k[k] * (1.0 - 2.0 * s.spring_d0[k] / (d0 + d1))
            pull += 2.0 * s.spring_c[k] * (d1 - d0) / (h * (d0 + d1))
            force = -0.5 * pull * (lines[0] + lines[1])
            for e, sign, own in zip(ends, (1.0, -1.0), points, strict=True):
                if e != GROUND:
                    arm = 0.5 * (own[0] + own[1] - a.r[e] - b.r[e])
                    out[e] += sign * np.concatenate((force, np.cross(arm, force)))
        for k, e in enumerate(s.load_i):
            pushes = [m.load(k, x.t, x.r[e], x.R[e]) for x in (a, b)]
            force, torque, point = (0.5 * (x + y) for x, y in zip(*pushes, strict=True))
            out[e] += np.concatenate((force, torque + np.cross(point - 0.5 * (a.r[e] + b.r[e]), force)))
        return out.ravel()

    def turn_to_bodies(self, h: float, a: Node, v_m: np.ndarray, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return wrenches ``w`` [space] with their torques multiplied by R_m^-1 = (1 - h/2 hat(Omega_m)) R_0^T."""
        six = w.reshape(-1, 6).copy()
        turned = np.einsum("bji,bj->bi", a.R, six[:, 3:])
        six[:, 3:] = turned - 0.5 * h * np.cross(v_m[:, 3:], turned)
        return six.ravel()


def _cayley(half: Float[np.ndarray, "nb 3"]) -> Float[np.ndarray, "nb 3 3"]:
    """Return Cayley's rotations (1 - hat(x))^-1 (1 + hat(x)) of x = ``half``."""
    x, square = so3.hat(half), np.sum(half * half, axis=1)[:, None, None]
    return np.eye(3) + 2.0 / (1.0 + square) * (x + x @ x)


def integrate(problem: Problem, control: StepControl, tolerance: float) -> Trajectory:
    """Integrate by mean-value steps from the start to ``t_end``, and return the trajectory."""
    return march(problem, control, Step(problem, tolerance))
