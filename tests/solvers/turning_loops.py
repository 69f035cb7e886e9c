"""Loops of three bars and four hinges in space whose crank turns, without forces: their motion in closed form.

Where nothing acts, 2 T = m(theta) theta_dot^2 is constant, so that a whole turn of the crank takes the integral of
sqrt(m / 2 T) over it and ends where it began, at the velocities it began with. Poses by the angle of the crank come
from the linkage's own closure; their derivatives, and so m and the start, from complex steps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mbsbench import Joint, Problem, RigidBody, State, assemble

X, Z = np.eye(3)[0], np.eye(3)[2]
STEP = 1e-30
START, RATE = 0.9, 6.0
BODIES = tuple(RigidBody(m, np.diag([0.02, 0.11, 0.12]) * m) for m in (1.0, 2.0, 1.5))
NODES = 4000  # of a periodic integrand: the sum is exact to rounding


@dataclass(frozen=True)
class Loop:
    """``frames`` of a crank angle (which may be complex): the four hinges' points, and R of the three bodies.

    Hinge k turns about the third axis of body k - 1, the first and the last on the ground about ``axes``.
    """

    frames: Callable[[complex], tuple[np.ndarray, np.ndarray]]
    axes: tuple[np.ndarray, np.ndarray]

    def poses(self, angle: complex) -> tuple[np.ndarray, np.ndarray]:
        """r (3, 3) half way between hinges, R (3, 3, 3)."""
        ends, R = self.frames(angle)
        return (ends[:-1] + ends[1:]) / 2.0, R

    def at(self, angle: float, rate: float = 1.0) -> State:
        """The state at a crank angle that changes by ``rate``."""
        r, R = self.poses(complex(angle, STEP))
        spin = np.swapaxes(R.real, 1, 2) @ R.imag / STEP
        Omega = np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=1)
        return State(r.real, R.real, rate * r.imag / STEP, rate * Omega)

    def period(self) -> float:
        """[s] of a turn that starts at ``START`` with ``RATE``."""
        angles = START + 2.0 * np.pi * np.arange(NODES) / NODES
        m = np.array([inertia(self.at(a)) for a in angles])
        return float(2.0 * np.pi * np.mean(np.sqrt(m / m[0])) / RATE)

    def problem(self, name: str, turns: float = 1.0, dt: float = 1e-3) -> Problem:
        """Whole turns of it."""
        s, (ends, _) = self.at(START, RATE), self.frames(complex(START))
        ends = ends.real

        def local(b: int, p: np.ndarray) -> np.ndarray:
            return s.R[b].T @ (p - s.r[b])

        joints = []
        for k in range(4):
            axis = self.axes[k // 3] if k in (0, 3) else s.R[k - 1] @ Z
            i, j = min(k, 2), (-1 if k in (0, 3) else k - 1)
            there = (ends[k], axis) if j < 0 else (local(j, ends[k]), s.R[j].T @ axis)
            joints.append(Joint(i, local(i, ends[k]), j, there[0], s.R[i].T @ axis, there[1], str(k)))
        system = assemble(BODIES, joints, (0.0, 0.0, 0.0))
        t_end = turns * self.period()
        return Problem(name, system, s, t_end=t_end, dt=dt, section="", source="made for this test")


def inertia(s: State) -> float:
    """2 T"""
    return sum(b.mass * v @ v + w @ b.inertia @ w for b, v, w in zip(BODIES, s.v, s.Omega, strict=True))


def bennett(a: float = 1.0, b: float = 1.6, alpha: float = 0.6) -> Loop:
    """Opposite links of lengths a, b and twists alpha, beta, b sin alpha = a sin beta.

    Its closure: tan(t1/2) tan(t2/2) = sin((beta + alpha)/2) / sin((beta - alpha)/2).
    """
    beta = np.arcsin(b / a * np.sin(alpha))
    ratio = np.sin((beta + alpha) / 2.0) / np.sin((beta - alpha) / 2.0)

    def frames(angle: complex) -> tuple[np.ndarray, np.ndarray]:
        other, M, made = 2.0 * np.arctan(ratio / np.tan(angle / 2.0)), np.eye(4, dtype=complex), []
        for turn, length, twist in ((angle, a, alpha), (other, b, beta), (-angle, a, alpha)):
            M = M @ _link(turn, length, twist)
            made.append(M)
        return np.array([np.zeros(3), *(m[:3, 3] for m in made)]), np.array([m[:3, :3] for m in made])

    last = (frames(complex(START))[1][2] @ Z).real
    return Loop(frames, (Z, last))


def _link(turn: complex, length: float, twist: float) -> np.ndarray:
    c, s, ca, sa = np.cos(turn), np.sin(turn), np.cos(twist), np.sin(twist)
    return np.array([[c, -s * ca, s * sa, length * c], [s, c * ca, -c * sa, length * s], [0, sa, ca, 0], [0, 0, 0, 1]])


def skew_crank_rocker(lengths: tuple[float, float, float, float] = (0.5, 1.3, 1.1, 1.2)) -> Loop:
    """A crank, a coupler, a rocker and the ground in a plane that no axis of space is normal to; its crank turns."""
    crank, coupler, rocker, ground = lengths
    c, s = np.cos(0.8), np.sin(0.8)
    T = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])

    def frames(angle: complex) -> tuple[np.ndarray, np.ndarray]:
        A, D = crank * np.array([np.cos(angle), np.sin(angle)]), np.array([ground, 0.0])
        d = D - A
        square = d @ d
        along = (square + coupler**2 - rocker**2) / (2.0 * square)
        across = np.sqrt(coupler**2 / square - along**2)
        B = A + along * d + across * np.array([-d[1], d[0]])
        flat = (np.zeros(2), A, B, D)
        ends = np.array([T @ np.append(p, 0.0) for p in flat])
        R = []
        for p, q in pairwise(flat):
            e = (q - p) / np.sqrt((q - p) @ (q - p))
            R.append(T @ np.array([[e[0], -e[1], 0.0], [e[1], e[0], 0.0], [0.0, 0.0, 1.0]]))
        return ends, np.array(R)

    return Loop(frames, (T @ Z, T @ Z))
