"""Evaluate route 1's moving rows: a force at a point x and a torque on body i, the opposite on j, and their rates.

    phi_dot = F . (v_i(x) - v_j(x)) + T . (omega_i - omega_j) + phi_t

with v_b(x) the velocity of body b's material point at x. One joint at a time; vectors are in space.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

ZERO = np.zeros(3)


class MovingRowRates(NamedTuple):
    """A moving row: its force and torque on body i for a reaction of 1, and their rates at constant velocities."""

    phi: float
    phi_t: float
    phi_t_rate: float
    F: np.ndarray  # force on body i
    F_rate: np.ndarray
    T: np.ndarray  # torque on body i
    T_rate: np.ndarray
    x: np.ndarray  # [m] where F acts
    x_rate: np.ndarray

    def acceleration(self, i: "Body", j: "Body") -> float:
        """Return phi_ddot of the row while both bodies keep v and omega."""
        bend = cross(i.omega, self.x_rate - i.v) - cross(j.omega, self.x_rate - j.v)
        seen = i.velocity(self.x) - j.velocity(self.x)
        turning = self.T_rate @ (i.omega - j.omega)
        return self.F_rate @ seen + self.F @ bend + turning + self.phi_t_rate


class Body(NamedTuple):
    """The position of C, orientation, velocity and angular velocity of a body, in space."""

    r: np.ndarray
    R: np.ndarray
    v: np.ndarray
    omega: np.ndarray

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """Return the velocity [m/s] of the body's material point at ``x`` in space."""
        return self.v + cross(self.omega, x - self.r)


class Joint(NamedTuple):
    """The points [m] and directions of a joint in its bodies' frames, and its function of time f, f_dot, f_ddot."""

    s_i: np.ndarray
    s_j: np.ndarray
    u: np.ndarray
    n: np.ndarray
    length: float
    f: tuple[float, float, float]


def _driven_position(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = n . d - f of a driven position, as a list of one; d is the gap of the joint's points."""
    x, n = i.r + i.R @ p.s_i, j.R @ p.n[0]
    phi = n @ (x - j.r - j.R @ p.s_j) - p.f[0]
    return [MovingRowRates(phi, -p.f[1], -p.f[2], n, cross(j.omega, n), ZERO, ZERO, x, i.velocity(x))]


def _driven_distance(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = |d| - f of a driven distance, as a list of one."""
    x, y = i.r + i.R @ p.s_i, j.r + j.R @ p.s_j
    d, d_dot = x - y, i.velocity(x) - j.velocity(y)
    distance = np.sqrt(d @ d)
    e = d / distance
    e_dot = (d_dot - (e @ d_dot) * e) / distance
    return [MovingRowRates(distance - p.f[0], -p.f[1], -p.f[2], e, e_dot, ZERO, ZERO, x, i.velocity(x))]


def _driven_angle(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = u . n(f) = sin(theta - f) of a driven angle: a pure torque u x n(f), no force."""
    f, f_dot, f_ddot = p.f
    u, n_1, n_2 = i.R @ p.u, j.R @ p.n[0], j.R @ p.n[1]
    n, dn = n_1 * np.cos(f) + n_2 * np.sin(f), n_2 * np.cos(f) - n_1 * np.sin(f)
    u_dot = cross(i.omega, u)
    n_dot, dn_dot = cross(j.omega, n) + dn * f_dot, cross(j.omega, dn) - n * f_dot
    phi_t_rate = (u_dot @ dn + u @ dn_dot) * f_dot + u @ dn * f_ddot
    T_rate = cross(u_dot, n) + cross(u, n_dot)
    return [MovingRowRates(u @ n, u @ dn * f_dot, phi_t_rate, ZERO, ZERO, cross(u, n), T_rate, i.r, i.v)]


def _knife_edge(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row u . (v_i - v_j) - f = 0 of a knife edge, which has no phi, as a list of one."""
    x, u = i.r + i.R @ p.s_i, i.R @ p.u
    return [MovingRowRates(0.0, -p.f[0], -p.f[1], u, cross(i.omega, u), ZERO, ZERO, x, i.velocity(x))]


def _rolling(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the three rows of a rolling disc: the height of its lowest point, and no slip there in two directions."""
    centre, axis, n = i.r + i.R @ p.s_i, i.R @ p.u, j.R @ p.n[0]
    axis_dot, n_dot = cross(i.omega, axis), cross(j.omega, n)
    down = (n @ axis) * axis - n
    down_dot = (n_dot @ axis + n @ axis_dot) * axis + (n @ axis) * axis_dot - n_dot
    steep = np.sqrt(down @ down)
    x = centre + (p.length / steep) * down
    x_dot = i.velocity(centre) + p.length / steep * (down_dot - (down @ down_dot) / steep**2 * down)
    phi = n @ (x - j.r - j.R @ p.s_j)
    ways = [j.R @ way for way in p.n]
    return [
        MovingRowRates(phi if k == 0 else 0.0, 0.0, 0.0, way, cross(j.omega, way), ZERO, ZERO, x, x_dot)
        for k, way in enumerate(ways)
    ]


def _rack(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = r theta - e . d of a rack and pinion: a force along the rack, a torque on the pinion.

    The torque is r if u is normal to the pinion's axis.
    """
    x, u, e, b = i.r + i.R @ p.s_i, i.R @ p.u, -(j.R @ p.n[1]), j.R @ p.n[0]
    axis = cross(e, b)
    ahead = cross(axis, u)
    square = ahead @ ahead
    u_dot, ahead_dot = cross(i.omega, u), cross(cross(j.omega, axis), u) + cross(axis, cross(i.omega, u))
    turn = cross(u, ahead)
    T = p.length / square * turn
    turn_dot = cross(u_dot, ahead) + cross(u, ahead_dot)
    T_rate = p.length / square * (turn_dot - 2.0 * (ahead @ ahead_dot) / square * turn)
    slip = np.arctan2(u @ b, u @ e) - e @ (x - j.r - j.R @ p.s_j) / p.length
    phi = p.length * (np.remainder(slip + np.pi, 2.0 * np.pi) - np.pi)
    return [MovingRowRates(phi, 0.0, 0.0, -e, -cross(j.omega, e), T, T_rate, x, i.velocity(x))]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b of two vectors (3,), without NumPy's overhead."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


PUSHES: dict[str, Callable[[Body, Body, Joint], list[MovingRowRates]]] = {
    "driven position": _driven_position,
    "driven angle": _driven_angle,
    "driven distance": _driven_distance,
    "knife edge": _knife_edge,
    "rolling disc": _rolling,
    "rack and pinion": _rack,
}
